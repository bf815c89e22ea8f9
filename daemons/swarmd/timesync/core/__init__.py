"""Decisions of time synchronisation: exchanges in, conversion functions out; no socket or clock."""
