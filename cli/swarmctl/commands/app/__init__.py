"""`swarmctl app`."""
