"""`swarmctl motors`."""
