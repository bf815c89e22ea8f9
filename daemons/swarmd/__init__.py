"""The daemons: a folder each, whose `core` decides and whose `service` acts; a daemon never imports a daemon.

Beside them the command `swarmd`, the parent of a node's processes and its fork server; no daemon's logic.
"""
