"""The fork server of one or several nodes: a process that imports the daemons once and forks for each
process.

A forked daemon starts in a fraction of the processor time that a new interpreter needs, and shares the
memory of its code with the other daemons. The server holds no thread, ZeroMQ socket, mapped file or lock,
because a fork would break or inherit them. Its stdin is a pipe from the parent of the node, so the server
ends with the parent; a server that several nodes share stays until the last forked process has ended.
"""

import ctypes
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

from swarmware.errors import SwarmError, WireError
from swarmware.service.fork_client import MESSAGE_BYTES, REQUEST_BYTES, exit_status_of
from swarmware.service.installed import find, installed
from swarmware.service.notify import Notifier

OURS: Final = "swarmd."
"""Only daemons of this package are imported: imports of other packages may start threads."""
BACKLOG: Final = 64
_ARG_START: Final = 45
"""Position of arg_start (field 48) behind the command name; arg_end follows. Source: proc_pid_stat(5)."""


_ENVIRONMENT_START: Final = 47
"""Position of env_start (field 50) behind the command name; env_end follows. Source: proc_pid_stat(5)."""
_NEW_NETWORK: Final = 0x4000_0000
"""CLONE_NEWNET of sched.h."""
_FILES: Final = 3
"""Descriptors that come with a request: output, errors, and the network namespace."""


class ForkRequest(msgspec.Struct, frozen=True):
    """Services that a forked process runs, its configuration, and the environment of the requester."""

    names: tuple[str, ...]
    config_dir: Path
    folder: str
    """Working directory of the forked process."""
    variables: dict[str, str]
    """Whole environment of the forked process."""

    @classmethod
    def parse(cls, data: bytes) -> "ForkRequest":
        """Decodes a request. Raises: WireError or another ValueError."""
        config_dir, folder, count, *words = os.fsdecode(data).split("\0")
        names, pairs = words[: int(count)], words[int(count) :]
        if not names:
            raise WireError("fork request without services; expected one or more")
        return cls(tuple(names), Path(config_dir), folder, dict(pair.split("=", 1) for pair in pairs))


def preload(names: Sequence[str]) -> None:
    """Imports the service runner, and the services that belong to this package.

    Raises: SwarmError when an import has started a thread. A fork would not copy the thread, and the locks
    that it holds would stay locked in the child.
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

    def __init__(self, path: Path, *, shared: bool = False) -> None:
        """`shared`: several nodes use the server, which then stays until its last forked process has
        ended."""
        self._path = path
        self._shared = shared
        self._inode = 0
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        self._wake, self._waker = socket.socketpair()
        self._asking: dict[int, socket.socket] = {}
        """Connections whose request has not arrived yet, by descriptor."""
        self._status: dict[int, socket.socket] = {}
        """Connections that are to receive the exit status of a process, by its pid."""

    def run(self) -> ForkRequest | None:
        """Serves requests until the parent of the node ends.

        Returns None in the server, and the request in each forked process.
        """
        for end in (self._wake, self._waker):
            end.setblocking(False)
        # Python writes to the wake-up descriptor only for signals that have a handler
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(self._waker.fileno(), warn_on_full_buffer=False)
        self._path.unlink(missing_ok=True)
        self._listener.bind(str(self._path))
        self._listener.listen(BACKLOG)
        self._inode = self._path.stat().st_ino
        # only after `listen`, because the parent sends requests as soon as it has received READY
        notifier = Notifier()
        notifier.ready("fork server")
        notifier.close()
        left = False
        while True:
            if left and not (self._shared and self._status):
                self._leave()
                return None
            watched: list[int | socket.socket] = [self._listener, self._wake, *self._asking.values()]
            if not left:
                watched.append(0)
            ready, _, _ = select.select(watched, [], [])
            if self._wake in ready:
                self._wake.recv(MESSAGE_BYTES)
                self._collect()
            # stdin is a pipe from the parent, at its end when the parent has ended
            if 0 in ready and not os.read(0, 1):
                left = True
                continue
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
        files: list[int] = []
        try:
            data, files, _, _ = socket.recv_fds(asking, REQUEST_BYTES, _FILES, socket.MSG_CMSG_CLOEXEC)
            order = ForkRequest.parse(data)
            output, errors, network = files
            pid = None if _closed(asking) else os.fork()
            if pid == 0:
                self._become(order, output, errors, network)
                return order
        except (OSError, ValueError) as error:
            sys.stderr.write(f"swarmd: fork server: {error}\n")
            pid = None
        finally:
            for fd in files:
                os.close(fd)
        if pid is None:
            asking.close()  # the requester then starts the process itself
            return None
        self._status[pid] = asking
        with suppress(OSError):  # the requester has died meanwhile; the process continues
            asking.send(b"%d" % pid)
        return None

    def _become(self, order: ForkRequest, output: int, errors: int, network: int) -> None:
        """Turns the new process from a copy of the server into a process of the requester."""
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        self._close()
        os.setsid()
        null = os.open(os.devnull, os.O_RDONLY)
        for number, fd in enumerate((null, output, errors)):
            os.dup2(fd, number)
        os.close(null)
        try:
            if _is_other_network(network):
                _enter_network(network)
            os.chdir(order.folder)
        except OSError as error:
            sys.stderr.write(f"swarmd: {error}\n")
            # without unwinding the stack, whose frames belong to the server
            os._exit(SwarmError.exit_code)
        os.environ.clear()
        os.environ.update(order.variables)
        _overwrite(_ENVIRONMENT_START, [f"{key}={value}" for key, value in order.variables.items()])
        command = ["run", *order.names, "--config", str(order.config_dir)]
        _overwrite(_ARG_START, [sys.executable, "-m", "swarmd", *command])

    def _close(self) -> None:
        for one in (self._listener, self._wake, self._waker, *self._asking.values(), *self._status.values()):
            one.close()

    def _leave(self) -> None:
        signal.set_wakeup_fd(-1)
        if self._path.exists() and self._path.stat().st_ino == self._inode:  # not the socket of a next server
            self._path.unlink()
        self._close()

    def _collect(self) -> None:
        """Collects ended processes, and sends their exit status to the requesters."""
        while True:
            try:
                result = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG)
            except ChildProcessError:
                return
            if result is None:
                return
            if (status := self._status.pop(result.si_pid, None)) is not None:
                with status, suppress(OSError):  # the requester may have ended as well
                    status.send(str(exit_status_of(result)).encode())


def _closed(asking: socket.socket) -> bool:
    """True if the requester has ended, or has given up waiting and started the process itself."""
    poller = select.poll()
    poller.register(asking, 0)
    return bool(poller.poll(0))


def _is_other_network(network: int) -> bool:
    own, other = Path("/proc/self/ns/net").stat(), os.stat(network)
    return (own.st_dev, own.st_ino) != (other.st_dev, other.st_ino)


def _enter_network(network: int) -> None:
    """Moves this process to another network namespace. Raises: OSError."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.setns(network, _NEW_NETWORK):
        number = ctypes.get_errno()
        raise OSError(number, f"network namespace: {os.strerror(number)}")


def _overwrite(field: int, words: list[str]) -> None:
    """Makes `ps` and other readers of /proc show the command line or environment of the forked process.

    The text overwrites that memory in place, and is cut if the memory is too small.
    """
    text = b"\0".join(os.fsencode(word) for word in words) + b"\0"
    try:
        fields = Path("/proc/self/stat").read_bytes().rpartition(b")")[2].split()
        begin, end = int(fields[field]), int(fields[field + 1])
        with Path("/proc/self/mem").open("r+b", buffering=0) as memory:
            memory.seek(begin)
            memory.write(text[: end - begin - 1].ljust(end - begin, b"\0"))
    except (OSError, ValueError) as error:
        sys.stderr.write(
            f"swarmd: the command line of process {os.getpid()} in /proc stays outdated: {error}\n"
        )
