"""Decisions of the monitor, without sockets or clock: states of faults, checks of modules, own rules."""
