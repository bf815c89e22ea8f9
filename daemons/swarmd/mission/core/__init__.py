"""Decisions of the mission daemon: admission, barrier, execution, state; no input, output or clock."""
