"""Applications of the nodes."""
