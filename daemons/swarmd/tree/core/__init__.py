"""Decisions of the tree: structures, subscriptions, notifications, settings; no socket, file or clock."""
