"""Frames between nodes: next hop, queue, signature from end to end, carrier, and the reliable link."""
