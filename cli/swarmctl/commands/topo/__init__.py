"""`swarmctl topo`."""
