"""Hardware abstraction layer: publishes devices as resources, each at its own rate (S2.2, S2.5).

The service opens and reads the drivers; a driver contains everything about its device.
"""
