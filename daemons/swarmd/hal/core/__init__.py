"""Decisions of the hardware abstraction: schedule of readings, filters of samples, stamps of packets."""
