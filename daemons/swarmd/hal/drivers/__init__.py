"""Drivers of devices: one file for each device or protocol, which knows its resources and nothing else."""
