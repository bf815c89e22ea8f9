"""`swarmctl mission`."""
