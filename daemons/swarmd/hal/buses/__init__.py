"""Buses to devices, behind the interface of `bus.py`: files of the kernel, opened by an address.

The content of the transfers belongs in the driver of the device, and its decoding in `core`.
"""
