"""`swarmctl config`."""
