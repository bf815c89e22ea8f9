"""Services: one class with `run()`, alone in a process or with others (S1.3, S1.12), and what runs them.

Here live the base class, its runner and the words with systemd; no daemon.
"""

from swarmware.service.service import Service

__all__ = ["Service"]
