"""Decisions of the tree: index, structure exchange, subscriptions, settings. No sockets, no files, no clock."""
