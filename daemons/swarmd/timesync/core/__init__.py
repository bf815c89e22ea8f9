"""Decisions of time synchronisation: exchanges in, conversion functions out. No socket or clock."""
