"""Decisions of the logger: which values are recorded, at which rate; no input, output or clock."""
