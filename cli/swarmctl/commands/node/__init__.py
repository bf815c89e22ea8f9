"""Nodes of the swarm."""
