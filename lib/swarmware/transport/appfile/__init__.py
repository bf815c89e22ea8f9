"""The application files of a node: which applications run, what each provides, serves and reads (ADR 1).

A locked file per application: the kernel releases the lock when its holder dies, so no server is needed to
detect living applications.
"""
