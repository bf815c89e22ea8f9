"""Middleware for unmanned swarms; a functional module begins with `from swarmware import Module`.

    async with Module("planner") as m:                       # joins the node of this computer
        pose = m.reader("nav/pose", Pose)                    # board: the newest value
        goal = m.inbox("cmd/goto", Goal)                     # messages: each exactly once
        path = m.stream_writer("plan/path", Pose)            # stream: every step, in order

`swarmctl docs` opens the documentation in a browser: quick start, tutorials (`swarmctl docs tutorials`),
how-to guides, reference of this library (`swarmctl docs reference/library`). In the sources it is the
folder share/doc.

`swarmctl new module NAME` makes a module to begin with, and its test; so do `new driver`, `new service`,
`new block` and `new mission`. Examples are in share/swarm/examples, of the sources or of the environment in
which the package is installed.

`help(swarmware.Module)` lists what a module can do, `help(swarmware.Service)` how it becomes a daemon that
`swarmd run NAME` starts. Payload types are in `swarmware.types`, or are your own `msgspec.Struct`s.

Which node is joined: the one whose configuration folder `Module(config_dir=...)` gives, else the environment
variable SWARM_CONFIG, else /etc/swarm. `swarmd` and `swarmctl` read the same variable.
"""

# lazy public names only, so that no core drags in a socket

from __future__ import annotations

from swarmware.footprint.annotations import TYPE_CHECKING
from swarmware.version import __version__

if TYPE_CHECKING:
    from swarmware.module.module import Module
    from swarmware.service.service import Service

__all__ = ["Module", "Service", "__version__"]

_HOMES = {"Module": "swarmware.module.module", "Service": "swarmware.service.service"}


def __getattr__(name: str) -> object:
    if name in _HOMES:
        from importlib import import_module

        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'swarmware' has no attribute {name!r}")
