"""The import of the event loop without OpenSSL.

`asyncio` and `uvloop` import `ssl` for streams with TLS, which no part of a node uses: keys of the swarm
protect what leaves the computer. OpenSSL takes 5 MB of resident memory in each process, and a twentieth of
the time of a command.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import Final, Literal

from swarmware.errors import SwarmError

_SSL: Final = "ssl"


class _Absent(type):
    def __instancecheck__(cls, instance: object) -> bool:
        raise SwarmError(
            "this process has imported its event loop without TLS; expected an import of `ssl` before"
        )


class _NoTls(ModuleType):
    """Stands for `ssl` while the event loop is imported: errors that are never raised, and numbers."""

    class SSLContext(metaclass=_Absent):
        """Placeholder for the context of a stream with TLS."""

    def __getattr__(self, name: str) -> object:
        if name.startswith("__"):
            raise AttributeError(name)
        return 0 if name.isupper() else type(name, (Exception,), {})


def import_without_tls(loop: Literal["asyncio", "uvloop"]) -> None:
    """Import an event loop; streams with TLS then fail. `ssl` itself can be imported afterwards.

    Does nothing in a process that has imported `ssl` or `asyncio`.
    """
    if _SSL in sys.modules or "asyncio" in sys.modules:
        return
    sys.modules[_SSL] = _NoTls(_SSL)
    try:
        import_module(loop)
    finally:
        del sys.modules[_SSL]
