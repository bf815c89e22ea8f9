"""Services: one class with `run()`, alone in a process or with others (S1.3, S1.12), and what runs them.

Contains the base class, its runner, sd_notify and the supervision of processes; no daemon. The parent of a
node's processes imports the small files only.
"""
