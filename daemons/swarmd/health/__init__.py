"""Health monitor: checks of data, rules for resources, faults, the logical state of the platform.

The checks that a module runs itself are in `swarmware.health`.
"""
