"""The application files of a node: who runs here, what each provides, answers and reads (ADR 1).

A locked file per application: the kernel takes the lock back when its holder dies, so no server is needed to
know who lives.
"""
