"""`swarmctl log`."""
