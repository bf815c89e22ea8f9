"""`swarmctl doctor`."""
