"""`swarmctl host`: the node of this computer under systemd, set up and removed."""
