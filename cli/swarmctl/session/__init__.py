"""The joined node: the session of one command, and the running nodes and labs of this user's processes.

What asks for resources by path lives in `resources`, above.
"""
