"""The fork server of a node of several processes, or of several nodes: it imports the daemons once, and forks
itself for each process.

A forked daemon needs a fraction of the processor time of one that starts with an empty interpreter, and
shares the memory of its code with the others. The server holds no thread, socket of ZeroMQ, mapped file or
lock, which a fork would break or inherit. Its stdin is a pipe from the parent of the node, so it ends with
the parent; one that is shared by nodes stays until the last process that it has forked has ended.
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

from swarmware.errors import SwarmError, WireError
from swarmware.service.fork import MESSAGE_BYTES, REQUEST_BYTES, exit_status_of
from swarmware.service.installed import find, installed
from swarmware.service.notify import Notifier

OURS: Final = "swarmd."
"""Only daemons of this package are imported: imports of other packages may start threads."""
BACKLOG: Final = 64
_ARG_START: Final = 45
"""Position of arg_start (field 48) behind the command name; arg_end follows. Source: proc_pid_stat(5)."""


_ENVIRONMENT_START: Final = 47
"""The same of the environment: env_start (field 50), env_end."""
_NEW_NETWORK: Final = 0x4000_0000
"""CLONE_NEWNET of sched.h."""
_FILES: Final = 3
"""Descriptors that come with a request: output, errors, and the network namespace."""


class ForkRequest(msgspec.Struct, frozen=True):
    """Services that a forked process runs, its configuration, and what it takes over from the requester."""

    names: tuple[str, ...]
    config_dir: Path
    folder: str
    """Working directory."""
    variables: dict[str, str]
    """Its whole environment."""

    @classmethod
    def parse(cls, data: bytes) -> "ForkRequest":
        """The request in these bytes. Raises: WireError or another ValueError."""
        config_dir, folder, count, *words = os.fsdecode(data).split("\0")
        names, pairs = words[: int(count)], words[int(count) :]
        if not names:
            raise WireError("a request without services")
        return cls(tuple(names), Path(config_dir), folder, dict(pair.split("=", 1) for pair in pairs))


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

    def __init__(self, path: Path, *, shared: bool = False) -> None:
        """`shared`: by several nodes: it stays until the last process that it has forked has ended."""
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
            if _is_other_network(network):
                import ctypes  # noqa: F401  # once, not in each process
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
        """Releases all resources of the server in the new process, and takes over those of the requester."""
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


def _is_other_network(network: int) -> bool:
    own, other = Path("/proc/self/ns/net").stat(), os.stat(network)
    return (own.st_dev, own.st_ino) != (other.st_dev, other.st_ino)


def _enter_network(network: int) -> None:
    """Moves this process, of one thread, to a network namespace. Raises: OSError."""
    import ctypes

    libc = ctypes.CDLL(None, use_errno=True)
    if libc.setns(network, _NEW_NETWORK):
        number = ctypes.get_errno()
        raise OSError(number, f"network namespace: {os.strerror(number)}")


def _overwrite(field: int, words: list[str]) -> None:
    """Makes `ps` and other readers of /proc show this command line or environment.

    It goes into the memory of the former one, as far as it fits.
    """
    text = b"\0".join(os.fsencode(word) for word in words) + b"\0"
    try:
        fields = Path("/proc/self/stat").read_bytes().rpartition(b")")[2].split()
        begin, end = int(fields[field]), int(fields[field + 1])
        with Path("/proc/self/mem").open("r+b", buffering=0) as memory:
            memory.seek(begin)
            memory.write(text[: end - begin - 1].ljust(end - begin, b"\0"))
    except (OSError, ValueError) as error:
        sys.stderr.write(f"swarmd: what /proc shows of {os.getpid()}: {error}\n")
