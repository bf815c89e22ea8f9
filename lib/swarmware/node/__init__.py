"""A process's attachment to its node: one per process, shared by all its modules and services.

It has what a process has once: configuration, clock, doorbell, message router, table of applications.
"""
