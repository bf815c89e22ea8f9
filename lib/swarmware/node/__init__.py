"""A process's attachment to its node: one per process, shared by all its modules and services.

It contains the singletons of a process: configuration, clock, doorbell, message router, table of
applications.
"""
