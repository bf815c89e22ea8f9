"""Decisions of the guard, without processes or clock: start, kill, restart and giving up of services."""
