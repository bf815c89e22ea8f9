"""Decisions of the tree: index, structure exchange, subscriptions, settings. No socket, file or clock."""
