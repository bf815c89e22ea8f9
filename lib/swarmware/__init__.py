"""The library a functional module imports: lazy public names only, so that no core drags in a socket."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from swarmware.module import Module
    from swarmware.service import Service

__version__ = "0.1.0"
__all__ = ["Module", "Service", "__version__"]

_HOMES = {"Module": "swarmware.module", "Service": "swarmware.service"}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'swarmware' has no attribute {name!r}")
