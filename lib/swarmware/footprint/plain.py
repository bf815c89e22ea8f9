"""`signal` and `socket` without enumerations: the interpreter's own C modules, with plain numbers.

The modules of the standard library wrap their numbers in `enum`, which imports `functools`, `collections` and
`selectors`. A socket of `socket.socket` has more methods than one of these: no `accept`, no context manager.
"""

from swarmware.footprint.annotations import TYPE_CHECKING

if TYPE_CHECKING:
    import signal
    import socket
else:
    import _signal as signal
    import _socket as socket

__all__ = ["signal", "socket"]
