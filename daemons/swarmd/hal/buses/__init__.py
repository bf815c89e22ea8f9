"""Buses to devices, each behind one interface: files of the kernel, opened by an address.

What travels on a bus belongs in the driver of the device, and its decoding in `core`.
"""
