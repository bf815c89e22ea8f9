"""Transport of bytes between applications: shared memory, messages, their delivery, keys.

The node has what a process holds once of these; payload types are in `swarmware.types`.
"""
