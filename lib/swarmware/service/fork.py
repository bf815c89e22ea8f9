"""A process of a service that was started, and how the fork server of the node is asked for one.

The fork server has imported what daemons need and forks itself: a start takes milliseconds, not half a second
of processor time. Without one, or if it does not answer, processes are started from scratch.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import struct
from contextlib import suppress

TYPE_CHECKING = False  # the parent of a node lives without `typing`, which costs a megabyte
if TYPE_CHECKING:
    from typing import Final

    Path = str | os.PathLike[str]

FOLDER: Final = "parent"
"""In the run directory, closed to all other users: sockets of the parent and of its fork server."""
SOCKET: Final = "fork"
MESSAGE_BYTES: Final = 8192
ANSWER_S: Final = 2.0
"""A fork takes milliseconds; a server that needs longer hangs, and is killed: the parent starts another."""
ENDED_S: Final = 0.3
"""The kernel reports the end of a process first, the fork server how it ended a moment later."""
_PEER: Final = struct.Struct("3i")
"""pid, uid, gid. Source: unix(7), SO_PEERCRED."""


def own_folder(run_dir: Path, name: str) -> str:
    """A folder in the run directory that is closed to all other users; made if need be."""
    folder = os.path.join(run_dir, name)
    os.makedirs(os.path.dirname(os.path.abspath(run_dir)), exist_ok=True)
    for path in (run_dir, folder):
        with suppress(FileExistsError):
            os.mkdir(path, mode=0o700)
    return folder


class Started:
    """A process that was started here; `status` reports how it ended when the fork server is its parent."""

    def __init__(self, pid: int, status: socket.socket | None = None) -> None:
        self.pid = pid
        self.status = status

    def how(self, timeout_s: float = 0.0) -> str:
        """How it ended: `signal 9`, `exit 1`; `gone` when that is not known (yet, or for ever)."""
        if self.status is None:
            return _collected(self.pid)
        poller = select.poll()
        poller.register(self.status, select.POLLIN)
        if poller.poll(timeout_s * 1000):
            with suppress(OSError):  # the fork server was killed: nobody knows
                return self.status.recv(MESSAGE_BYTES).decode("ascii") or "gone"
        return "gone"

    def close(self) -> None:
        """How it ends is of no interest any more."""
        if self.status is not None:
            self.status.close()
            self.status = None


def ask(names: list[str], config_dir: Path, run_dir: Path, *, speaks: bool) -> Started | None:
    """Has the fork server of the node start a process of these services; None: there is none that answers."""
    asking = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_CLOEXEC)
    try:
        asking.settimeout(ANSWER_S)
        asking.connect(os.path.join(run_dir, FOLDER, SOCKET))
        asking.send("\0".join(["speaks" if speaks else "", os.fspath(config_dir), *names]).encode())
        pid = int(asking.recv(MESSAGE_BYTES) or b"0")
    except TimeoutError:
        _end_server(asking)
        pid = 0
    except (OSError, ValueError):
        pid = 0  # there is none, it is being started, or it has just died
    if not pid:
        asking.close()
        return None
    asking.setblocking(False)
    return Started(pid, asking)


def _end_server(asking: socket.socket) -> None:
    """Kills a fork server that hangs. It forks for nobody who has closed the connection."""
    pid, uid, _ = _PEER.unpack(asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size))
    if uid == os.getuid() and pid > 0:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def _collected(pid: int) -> str:
    try:
        result = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG)
    except ChildProcessError:
        return "gone"  # a child of another process: that one learns how it ended
    return "gone" if result is None else ended(result)


def ended(result: os.waitid_result) -> str:
    """Words for what `waitid` returned."""
    return f"{'exit' if result.si_code == os.CLD_EXITED else 'signal'} {result.si_status}"
