"""RTP with the payload H.264, reports of receivers, rate control, and both ends of a video session."""
