"""Health guard: starts, watches and restarts the services of the node, above all the monitor `health`.

How a process is started and watched is in `swarmware.service`.
"""
