"""Forwarding of frames: the next hop, the queue of a link, frames as datagrams."""
