"""`signal` and `socket` without enumerations: the interpreter's own C modules, with plain numbers.

The modules of the standard library wrap their numbers in `enum`, which brings `functools`, `collections` and
`selectors` with it: a megabyte in the parent of a node, which lives as long as the node and calls neither.
A socket of `socket.socket` has more methods than one of these: no `accept`, no context manager.
"""

TYPE_CHECKING = False
if TYPE_CHECKING:
    import signal
    import socket
else:
    import _signal as signal
    import _socket as socket

__all__ = ["signal", "socket"]
