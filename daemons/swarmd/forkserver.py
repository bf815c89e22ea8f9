"""The fork server of a node of several processes: imports the modules of daemons once, and forks itself for
each.

A forked daemon needs a fraction of the processor time of one that starts with an empty interpreter, and
shares the memory of its code with the others. The server holds no thread, socket of ZeroMQ, mapped file or
lock, which a fork would break or inherit. Its stdin is a pipe from the parent of the node, so it ends with
the parent.
"""

import gc
import os
import select
import signal
import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from swarmware.errors import SwarmError
from swarmware.service.fork import FOLDER, MESSAGE_BYTES, SOCKET, exit_status_of
from swarmware.service.installed import find, installed
from swarmware.service.notify import Notifier
from swarmware.service.starting import environment

OURS: Final = "swarmd."
"""Only daemons of this package are imported: imports of other packages may start threads."""
BACKLOG: Final = 64
_ARG_START: Final = 45
"""Position of arg_start (field 48) behind the command name; arg_end follows. Source: proc_pid_stat(5)."""


class ForkRequest(msgspec.Struct, frozen=True):
    """Services that a forked process runs, and its configuration."""

    names: tuple[str, ...]
    config_dir: Path


def preload(names: Sequence[str]) -> None:
    """Imports the service runner and those of the services that belong to this package.

    Raises: SwarmError when an import has started a thread: a fork would lose it, with the locks that it
    holds.
    """
    import swarmware.service.runner  # noqa: F401

    points = installed()
    for name in names:
        if name in points and points[name].value.startswith(OURS):
            find(name)
    threads = len(list(Path("/proc/self/task").iterdir()))
    if threads > 1:
        raise SwarmError(f"fork server: the imports have started {threads - 1} threads; expected none")
    gc.collect()
    gc.freeze()  # a collection in a child would copy every page that it visits


class ForkServer:
    """Accepts requests on a socket in the run directory: one connection for each process."""

    def __init__(self, run_dir: Path) -> None:
        self._run_dir = run_dir
        self._path = run_dir / FOLDER / SOCKET
        self._inode = 0
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        self._wake, self._waker = socket.socketpair()
        self._asking: dict[int, socket.socket] = {}
        """Connections whose request has not arrived yet, by descriptor."""
        self._status: dict[int, socket.socket] = {}
        """Connections that are to receive the exit status of a process, by its pid."""

    def run(self) -> ForkRequest | None:
        """Serves requests. None: the parent of the node has ended. A request: this is the forked process for
        it."""
        for end in (self._wake, self._waker):
            end.setblocking(False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(self._waker.fileno(), warn_on_full_buffer=False)
        self._path.unlink(missing_ok=True)
        self._listener.bind(str(self._path))
        self._listener.listen(BACKLOG)
        self._inode = self._path.stat().st_ino
        notifier = Notifier()
        notifier.ready("fork server")
        notifier.close()
        while True:
            watched: list[int | socket.socket] = [0, self._listener, self._wake, *self._asking.values()]
            ready, _, _ = select.select(watched, [], [])
            if self._wake in ready:
                self._wake.recv(MESSAGE_BYTES)
                self._collect()
            if 0 in ready and not os.read(0, 1):
                self._leave()
                return None
            if self._listener in ready:
                self._accept()
            for asking in [one for one in self._asking.values() if one in ready]:
                del self._asking[asking.fileno()]
                if (order := self._answer(asking)) is not None:
                    return order

    def _accept(self) -> None:
        try:
            asking, _ = self._listener.accept()
        except OSError:
            return  # closed again, or no descriptor is free: the requester starts the process itself
        asking.setblocking(False)
        self._asking[asking.fileno()] = asking

    def _answer(self, asking: socket.socket) -> ForkRequest | None:
        """Forks for one request; returns the request in the new process, None in the server."""
        try:
            speaks, config_dir, *names = asking.recv(MESSAGE_BYTES).decode().split("\0")
            pid = os.fork() if names and not _closed(asking) else None
        except (OSError, ValueError) as error:
            sys.stderr.write(f"swarmd: fork server: {error}\n")
            pid = None
        if pid is None:
            asking.close()  # the requester then starts the process itself
            return None
        if pid == 0:
            self._become(names, config_dir, speaks=bool(speaks))
            return ForkRequest(tuple(names), Path(config_dir))
        self._status[pid] = asking
        with suppress(OSError):  # the requester has died meanwhile; the process continues
            asking.send(b"%d" % pid)
        return None

    def _become(self, names: Sequence[str], config_dir: str, *, speaks: bool) -> None:
        """Releases all resources of the server in the new process."""
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        self._close()
        os.setsid()
        null = os.open(os.devnull, os.O_RDONLY)
        os.dup2(null, 0)
        os.close(null)
        variables = environment(self._run_dir, notifies=speaks)
        os.environ.clear()
        os.environ.update(variables)
        _show_as([sys.executable, "-m", "swarmd", "run", *names, "--config", config_dir])

    def _close(self) -> None:
        for one in (self._listener, self._wake, self._waker, *self._asking.values(), *self._status.values()):
            one.close()

    def _leave(self) -> None:
        signal.set_wakeup_fd(-1)
        if self._path.exists() and self._path.stat().st_ino == self._inode:  # the next server may exist
            self._path.unlink()
        self._close()

    def _collect(self) -> None:
        """Collects ended processes, and sends each exit status to the requester."""
        while True:
            try:
                result = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG)
            except ChildProcessError:
                return
            if result is None:
                return
            if (status := self._status.pop(result.si_pid, None)) is not None:
                with status, suppress(OSError):  # the requester may have died, too
                    status.send(str(exit_status_of(result)).encode())


def _closed(asking: socket.socket) -> bool:
    """Whether the requester has ended or given up; then it has started the process itself."""
    poller = select.poll()
    poller.register(asking, 0)
    return bool(poller.poll(0))


def _show_as(command: list[str]) -> None:
    """Makes `ps` show this command line, as far as it fits into the memory of the former one."""
    text = b"\0".join(os.fsencode(word) for word in command) + b"\0"
    try:
        fields = Path("/proc/self/stat").read_bytes().rpartition(b")")[2].split()
        begin, end = int(fields[_ARG_START]), int(fields[_ARG_START + 1])
        with Path("/proc/self/mem").open("r+b", buffering=0) as memory:
            memory.seek(begin)
            memory.write(text[: end - begin - 1].ljust(end - begin, b"\0"))
    except (OSError, ValueError) as error:
        sys.stderr.write(f"swarmd: command line of {os.getpid()}: {error}\n")
