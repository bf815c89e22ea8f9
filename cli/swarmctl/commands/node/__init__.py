"""`swarmctl node`."""
