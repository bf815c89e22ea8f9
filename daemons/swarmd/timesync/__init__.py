"""Time synchronisation: one conversion function for the clock of each other node; clocks are never set.

The service exchanges functions with partners; the broker measures the stamps.
"""
