"""Decisions of the monitor: states of faults, checks of modules, own rules; no sockets or clock."""
