"""Services: one class with `run()`, alone in a process or with others (S1.3, S1.12), and what runs them.

Contains the base class, its runner, sd_notify and the supervision of processes; no daemon.
`Service` is imported on access: the parent of a node's processes stays small.
"""

from __future__ import annotations

TYPE_CHECKING = False  # the parent of a node lives without `typing`, which costs a megabyte
if TYPE_CHECKING:
    from typing import Any

    from swarmware.service.service import Service

__all__ = ["Service"]


def __getattr__(name: str) -> Any:
    if name == "Service":
        from swarmware.service.service import Service

        return Service
    raise AttributeError(f"module 'swarmware.service' has no attribute {name!r}")
