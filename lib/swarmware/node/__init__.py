"""A process's attachment to its node: one per process, shared by all its modules and services.

Here lives what a process has once: configuration, clock, doorbell, post, the table of applications.
"""
