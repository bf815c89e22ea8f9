"""Drivers: one file per device or protocol; a driver knows its device and its resources, nothing else."""
