"""`swarmctl link`."""
