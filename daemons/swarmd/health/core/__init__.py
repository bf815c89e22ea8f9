"""Decisions of the monitor: states of faults, checks of modules, own rules. No sockets."""
