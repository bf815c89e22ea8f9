"""Drivers of devices, one file per device or protocol, which contains nothing about other devices."""
