"""`swarmctl tree`."""
