"""Transfer of files in blocks: which are missing, which are sent next, and the file that is being received.

No requests and no rights: those are of the service `files` and of `swarmctl file`.
"""
