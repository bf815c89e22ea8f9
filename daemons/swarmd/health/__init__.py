"""Health monitor: checks of data, rules for resources, faults, the logical state of the platform.

What a module itself checks is in `swarmware.health`.
"""
