"""Health guard: starts, watches and restarts the services of the node, above all the monitor `health`.

The start and the watching of a single process are in `swarmware.service`.
"""
