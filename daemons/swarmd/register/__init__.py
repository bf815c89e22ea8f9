"""Application register: the preferred holder of the master role, and the tables of other computers.

The role itself is in `swarmware.node.master`, which every process has.
"""
