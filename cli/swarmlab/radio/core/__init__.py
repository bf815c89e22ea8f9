"""Decisions of the radio: airtime, range and loss by distance, impairments of single links, counters.

Nothing here has a clock, a device or a source of randomness of its own.
"""
