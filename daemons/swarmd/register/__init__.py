"""Application register: prefers to hold the master role, and keeps the tables of other computers.

The role itself is in `swarmware.node.master`, which every process has.
"""
