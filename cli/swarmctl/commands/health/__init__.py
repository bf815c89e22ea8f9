"""`swarmctl health`."""
