"""Buses to devices, behind the interface of `bus.py`: files of the kernel, opened by an address.

What travels on a bus belongs in the driver of the device, and its decoding in `core`.
"""
