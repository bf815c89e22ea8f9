"""Drivers: one file per device or protocol, each knows its device and its resources, nothing else."""
