"""The `node` commands: nodes of the swarm."""
