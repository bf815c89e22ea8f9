"""`swarmctl time`."""
