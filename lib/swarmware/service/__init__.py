"""Services: one class with `run()`, alone in a process or with others (S1.3, S1.12), and their runner.

Contains the base class, the runner, sd_notify and the supervision of processes; no daemon. The parent of a
node's processes imports only those modules that need no other package.
"""
