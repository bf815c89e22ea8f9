"""Decisions of the register: the newest table of each other computer; no input, output or clock."""
