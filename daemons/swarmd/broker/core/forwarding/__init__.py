"""Frames on their way: the next hop, the queue of a link, the frame in one datagram."""
