"""Decisions of the register: the newest table of each other computer. No input, output or clock."""
