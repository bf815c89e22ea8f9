"""When a datagram arrived, by the kernel: not when its process got the processor to read it."""

import socket
import struct
import time
from typing import Final

STAMP_LIMIT_NS: Final = 5_000_000_000
"""Larger differences come from a step of the wall clock: the stamp is not used."""
_SO_TIMESTAMPNS: Final = 35
_TIMESPEC: Final = struct.Struct("qq")
ANCILLARY: Final = socket.CMSG_SPACE(_TIMESPEC.size)
"""Room that `recvmsg` needs for a stamp."""
Ancillary = list[tuple[int, int, bytes]]
"""Beside a datagram, as `recvmsg` returns it."""


def enable(sock: socket.socket) -> None:
    """Has the kernel stamp what arrives at a socket."""
    sock.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)


class ArrivalStamps:
    """Converts the stamps of the datagrams that are read in one turn.

    The kernel stamps with the wall clock; how far that is from the monotonic one is asked in each turn.
    """

    __slots__ = ("_apart_ns", "_mono_ns")

    def __init__(self) -> None:
        # In this order: a pause between the two makes stamps late, as a delay would. Early ones would be
        # impossible, and would count as a clock step.
        wall_ns = time.time_ns()
        self._mono_ns = time.monotonic_ns()
        self._apart_ns = wall_ns - self._mono_ns

    def mono_ns(self, ancillary: Ancillary) -> int:
        """CLOCK_MONOTONIC at the arrival of a datagram with this ancillary data."""
        mono_ns = self._mono_ns
        if not ancillary:
            return mono_ns
        seconds, nanoseconds = _TIMESPEC.unpack(ancillary[0][2])
        stamp_ns: int = seconds * 1_000_000_000 + nanoseconds - self._apart_ns
        if 0 <= mono_ns - stamp_ns < STAMP_LIMIT_NS:
            return stamp_ns
        if stamp_ns > mono_ns:
            return min(stamp_ns, time.monotonic_ns())  # arrived during this read
        return mono_ns
