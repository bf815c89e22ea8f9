"""Protocols of devices that drivers and the simulation use: values to bytes, and bytes to values.

Without input and output. The registers of a chip, which only its driver knows, belong to the core of `hal`.
"""
