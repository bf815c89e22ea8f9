"""The swarm as this node knows it: neighbours with their links and media, names of nodes, and routes."""
