"""Decisions of the logger: which values are recorded. No input, output or clock."""
