"""Decisions of the hardware abstraction: when a device is read, filters of samples, stamps of packets."""
