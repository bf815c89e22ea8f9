"""How bytes get from one application to another: shared memory, messages, their delivery, keys.

What a process holds once of these is its node's; what a datum means is its type's.
"""
