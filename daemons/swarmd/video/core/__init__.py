"""RTP and its payload H.264, reports of receivers, rate control, and the two ends of a video session."""
