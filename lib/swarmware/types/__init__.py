"""Payload types that processes or platforms exchange: one file per area, and the registry with their codec.

A type has no behaviour but computations with its own fields; private structures of daemons are not here.
"""
