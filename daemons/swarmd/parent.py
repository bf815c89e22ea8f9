"""The parent of a node's processes: small, outside of shared memory, there to start the node again.

It lives as long as the node, so it imports only what it needs to start, to listen and to signal; whoever has
loaded more (`swarmd node` has read the configuration) makes room for it with `become`.
With `processes = "one"` its child runs all services, with "per-daemon" the guard, which starts the others.
A guard that another daemon has started is taken for its own as soon as it speaks.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import struct
import sys
import time
from contextlib import suppress

from swarmware.errors import SwarmError
from swarmware.service.births import BEAT_S, GUARD, NODE_SOCKET, launch, settled, spawn_missing
from swarmware.service.lives import Lives
from swarmware.service.notify import Notifier

TYPE_CHECKING = False  # the parent of a node lives without `typing`, which costs a megabyte
if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Final, NoReturn

HUNG_S: Final = 15.0
"""A process without a sign of life for so long is killed; an event loop gives one every few seconds."""
ELSEWHERE_S: Final = 0.3
"""Daemons start the guard again by themselves, and at once; so long they are left to do it."""
LATE_S: Final = 1.0
"""A parent that was kept from running for longer blames nobody for that time."""
RECEIVE_BYTES: Final = 4096
_CREDENTIALS: Final = struct.Struct("3i")
"""pid, uid, gid. Source: unix(7), SCM_CREDENTIALS."""
_NS: Final = 1_000_000_000
_ENTRY: Final = "import sys; from swarmd.parent import main; sys.exit(main(sys.argv[1:]))"
"""Half a megabyte less than `-m swarmd.parent`, whose runpy stays loaded."""


def become(platform: str, config_dir: Path, run_dir: Path, services: list[str], *, shared: bool) -> NoReturn:
    """This process becomes the parent of a node: same pid, same environment, an empty interpreter.

    `shared`: one process per daemon; the parent starts the guard, which starts the others.
    """
    words = ["node", platform, str(config_dir), str(run_dir) if shared else "", *services]
    os.execv(sys.executable, [sys.executable, "-c", _ENTRY, *words])


def main(words: list[str]) -> int:
    """The words of `become`; the exit code of the node."""
    _, platform, config_dir, run_dir, *services = words
    if not run_dir:
        return Parent(
            lambda: launch(services, config_dir, speaks=True), platform, shared=False, lives=Lives()
        ).run()
    try:
        return Parent(
            lambda: spawn_missing(GUARD, config_dir, run_dir), platform, shared=True, lives=Lives()
        ).run()
    finally:
        settled(GUARD, run_dir)


class Words:
    """The socket to which the child speaks as to systemd; only processes of this user are heard."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        self._socket.bind("")  # an abstract address of the kernel's choice
        self.address = "@" + self._socket.getsockname()[1:].decode()

    def fileno(self) -> int:
        """For poll."""
        return self._socket.fileno()

    def take(self) -> tuple[int, dict[str, str]] | None:
        """pid of the speaker and what it says; None when there is nothing more."""
        while True:
            try:
                data, ancillary, _, _ = self._socket.recvmsg(
                    RECEIVE_BYTES, socket.CMSG_SPACE(_CREDENTIALS.size)
                )
            except BlockingIOError:
                return None
            for level, kind, content in ancillary:
                if (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS):
                    pid, uid, _gid = _CREDENTIALS.unpack(content)
                    if uid == os.getuid():
                        lines = data.decode("utf-8", "replace").splitlines()
                        return pid, dict(line.partition("=")[::2] for line in lines)

    def close(self) -> None:
        """Hear no more."""
        self._socket.close()


class Parent:
    """Keeps one process running until it ends in peace, or this one is asked to end.

    `start` begins a process and gives its pid; 0: it runs already, started by somebody else.
    `shared`: others may start it too.
    """

    def __init__(self, start: Callable[[], int], platform: str, *, shared: bool, lives: Lives) -> None:
        self._start = start
        self._platform = platform
        self._shared = shared
        self._lives = lives
        self._above = Notifier()
        self._words = Words()
        os.environ[NODE_SOCKET] = self._words.address
        self._pid = 0
        self._pidfd = -1
        self._child = 0
        """The newest that we started ourselves: only its exit code is known to us."""
        self._started_ns = 0
        self._beat_ns = 0
        self._ready = False
        self._was_ready = False
        self._leaving = False
        self._asked = False
        self._due_ns: int | None = None

    def run(self) -> int:
        """Returns the exit code of the node."""
        wake, waker = socket.socketpair()
        for end in (wake, waker):
            end.setblocking(False)
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, self._on_signal)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(waker.fileno(), warn_on_full_buffer=False)
        poller = select.poll()
        for fd in (wake.fileno(), self._words.fileno()):
            poller.register(fd, select.POLLIN)
        try:
            self._begin()
            while True:
                code = self._turn(poller, wake)
                if code is not None:
                    return code
        finally:
            signal.set_wakeup_fd(-1)
            self._forget()
            self._words.close()
            self._above.close()
            for end in (wake, waker):
                end.close()

    def _turn(self, poller: select.poll, wake: socket.socket) -> int | None:
        if self._pidfd >= 0:
            poller.register(self._pidfd, select.POLLIN)
        watched = self._pidfd
        wait_s = self._wait_s()
        began_s = time.monotonic()
        ready = {fd for fd, _ in poller.poll(wait_s * 1000)}
        if time.monotonic() - began_s - wait_s > LATE_S:
            self._beat_ns = time.monotonic_ns()
        if watched >= 0:
            poller.unregister(watched)
        if wake.fileno() in ready:
            wake.recv(RECEIVE_BYTES)
        while (word := self._words.take()) is not None:
            self._hear(*word)
        if self._above.watchdog_s is not None:
            self._above.alive()
        if watched in ready and watched == self._pidfd:
            code = self._ended()
            if code is not None:
                return code
        self._reap()
        if self._asked and self._pid == 0:
            return 0
        self._on_time(time.monotonic_ns())
        return None

    def _wait_s(self) -> float:
        """Until something is due by time."""
        now_ns = time.monotonic_ns()
        due = [now_ns + round(BEAT_S / 2 * _NS)]
        if self._due_ns is not None:
            due.append(self._due_ns)
        if self._above.watchdog_s is not None:
            due.append(now_ns + round(self._above.watchdog_s * _NS))
        return max(0.0, (min(due) - now_ns) / _NS)

    # -- what happens

    def _on_signal(self, *_: object) -> None:
        self._asked = True
        self._above.stopping()
        self._signal(signal.SIGTERM)

    def _signal(self, number: signal.Signals) -> None:
        if self._pidfd >= 0:
            with suppress(ProcessLookupError):  # its end is in the next poll
                signal.pidfd_send_signal(self._pidfd, number)

    def _hear(self, pid: int, words: dict[str, str]) -> None:
        if self._shared and self._pid == 0:
            self._follow(pid)
        if pid != self._pid:
            return
        now_ns = self._beat_ns = time.monotonic_ns()
        self._leaving = self._leaving or "STOPPING" in words
        if "READY" in words:
            self._ready = True
            self._lives.on_ready(now_ns)
            self._above.ready(words.get("STATUS", ""))
            self._was_ready = True
        elif "STATUS" in words:
            self._above.status(words["STATUS"])
        if self._asked:
            self._signal(signal.SIGTERM)  # adopted after the signal

    def _follow(self, pid: int) -> bool:
        try:
            self._pidfd = os.pidfd_open(pid)
        except OSError:
            return False
        self._pid = pid
        self._due_ns = None
        self._ready = self._leaving = False
        self._beat_ns = self._started_ns = time.monotonic_ns()
        return True

    def _ended(self) -> int | None:
        """The process is no more; the node's exit code when it is not to be started again."""
        pid, was_ready, leaving = self._pid, self._ready, self._leaving
        how = self._how(pid)
        self._forget()
        peaceful = how == "exit 0" or (how == "gone" and leaving)
        kind, _, number = how.partition(" ")
        if self._asked or peaceful:
            return int(number) if kind == "exit" else 0 if how == "gone" else 128 + int(number)
        if kind == "exit" and not self._was_ready:
            return int(number)  # it has said why: a second try would say the same
        now_ns = time.monotonic_ns()
        pause_s = self._lives.on_end(now_ns, killed=was_ready and how in {"signal 9", "gone"})
        if pause_s is None:
            self._say(f"ended: {how}; given up after {self._lives.restarts} restarts")
            return SwarmError.exit_code
        if self._shared:
            pause_s = max(pause_s, ELSEWHERE_S)
        self._say(f"ended: {how}; starts again (restart {self._lives.restarts})")
        self._above.restarted(self._lives.restarts, how)
        self._due_ns = now_ns + round(pause_s * _NS)
        return None

    def _how(self, pid: int) -> str:
        if pid != self._child:
            return "gone"
        self._child = 0
        result = os.waitid(os.P_PID, pid, os.WEXITED)
        assert result is not None
        return f"{'exit' if result.si_code == os.CLD_EXITED else 'signal'} {result.si_status}"

    def _reap(self) -> None:
        """Collects orphans that the kernel has given to us: as the first process of a container."""
        while True:
            try:
                found = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
                if found is None or found.si_pid in {self._child, self._pid}:
                    return
                os.waitid(os.P_PID, found.si_pid, os.WEXITED | os.WNOHANG)
            except ChildProcessError:
                return

    def _on_time(self, now_ns: int) -> None:
        if self._due_ns is not None and now_ns >= self._due_ns:
            self._begin()
        elif self._ready and now_ns - self._beat_ns > HUNG_S * _NS:
            self._say(f"no sign of life for {HUNG_S:g} s: pid {self._pid} is killed")
            self._beat_ns = now_ns
            self._signal(signal.SIGKILL)

    def _begin(self) -> None:
        try:
            pid = self._start()
        except OSError as error:
            pid = 0
            self._say(f"cannot be started: {error}")
        if pid:
            self._child = pid
            self._follow(pid)
        else:
            self._due_ns = time.monotonic_ns() + round(ELSEWHERE_S * _NS)

    def _forget(self) -> None:
        if self._pidfd >= 0:
            os.close(self._pidfd)
        self._pid, self._pidfd = 0, -1
        self._ready = self._leaving = False

    def _say(self, text: str) -> None:
        stamp = time.strftime("%Y-%m-%d %H:%M:%S")
        sys.stderr.write(f"{stamp},000 {self._platform} WARNING swarm.node: {text}\n")
        sys.stderr.flush()
