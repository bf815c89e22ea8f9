"""`swarmctl traffic`."""
