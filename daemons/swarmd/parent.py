"""The parent of a node's processes: a small process without shared memory that restarts the node.

The parent runs as long as the node, so it imports only the modules for starting, notifications and signals.
`swarmd node` imports more to read the configuration, and then replaces itself by the parent with `become`.
With `processes = "one"` the child runs all services; with "per-daemon" the child is the guard, which starts
the others.
A guard that another daemon has started is adopted when its first notification arrives.
"""

from __future__ import annotations

import os
import select
import sys
import time

from swarmd.kept_folders import KEEP_VARIABLE, KeptFolders
from swarmd.parent_socket import ParentSocket
from swarmware.errors import SwarmError
from swarmware.footprint.annotations import TYPE_CHECKING, Callable, Final, NoReturn, Path
from swarmware.footprint.plain import signal
from swarmware.runtime.backoff import RestartPolicy
from swarmware.runtime.pidfd import ProcessHandle
from swarmware.service.exit_status import ExitStatus
from swarmware.service.fork_client import ENDED_S, VARIABLE, StartedProcess
from swarmware.service.notify import RECEIVE_BYTES, Notifier
from swarmware.service.starting import (
    BEAT_S,
    GUARD,
    WHOLE_NODE,
    clear_start_record,
    is_started,
    launch,
    spawn_missing,
    start_record,
    write_start_record,
)

if TYPE_CHECKING:
    from swarmd.fork_server_supervisor import ForkServerSupervisor

HUNG_S: Final = 15.0
"""Time without a heartbeat after which a process is killed; an event loop sends one every few seconds."""
ELSEWHERE_S: Final = 0.3
"""Period of the search for a process that another process starts; its notification ends the wait early."""
FORK_SERVER_S: Final = 10.0
"""Maximum time for which the first process waits for the fork server."""
LATE_S: Final = 1.0
"""Delay of the parent itself above which the time does not count as silence of the supervised process."""
_NS: Final = 1_000_000_000
ENTRY: Final = "import sys; from swarmd.parent import main; sys.exit(main(sys.argv[1:]))"
"""Python program of the parent; `-m swarmd.parent` would keep runpy loaded, half a megabyte more."""


def become(
    platform: str, config_dir: Path, run_dir: Path, services: list[str], *, shared: bool, fork_server: bool
) -> NoReturn:
    """Replaces this process by the parent of a node: same pid, same environment, an empty interpreter.

    `shared`: each daemon has a process; the parent starts the guard, which starts the others.
    `fork_server`: the parent starts a fork server.
    """
    modes = ["shared" if shared else "", "fork server" if fork_server else ""]
    words = ["node", platform, str(config_dir), str(run_dir), *modes, *services]
    os.execv(sys.executable, [sys.executable, "-P", "-c", ENTRY, *words])


def main(words: list[str]) -> int:
    """Runs the parent with the arguments of `become`; returns the exit code of the node."""
    _, platform, config_dir, run_dir, shared, fork_server, *services = words
    name = GUARD if shared else WHOLE_NODE

    def one() -> StartedProcess:
        pid, ticks = start_record(WHOLE_NODE, run_dir)
        if pid:
            # the previous parent was killed, but its child still runs
            return StartedProcess(pid, started=ticks)
        started = launch(services, config_dir, run_dir, notifies=True)
        write_start_record(WHOLE_NODE, started.pid, run_dir)
        return started

    def guard() -> StartedProcess | None:
        return spawn_missing(GUARD, config_dir, run_dir)

    def guard_is_elsewhere() -> bool:
        return bool(shared) and is_started(GUARD, run_dir)

    try:
        listening = ParentSocket(run_dir)
    except SwarmError as error:
        sys.stderr.write(f"swarmd: {error}\n")
        return error.exit_code
    kept = KeptFolders([run_dir, *filter(None, [os.environ.get(KEEP_VARIABLE)])])
    try:
        server = None
        if fork_server and (shared or VARIABLE not in os.environ):  # otherwise a shared server is used
            # loaded only by a node with a fork server
            from swarmd.fork_server_supervisor import ForkServerSupervisor

            server = ForkServerSupervisor(services, run_dir)
        start = guard if shared else one
        return Parent(start, guard_is_elsewhere, platform, listening, kept, RestartPolicy(), server).run()
    finally:
        clear_start_record(name, run_dir)
        listening.close()
        kept.close()


class Parent:
    """Keeps one process running until it ends without an error, or this process receives a signal to end.

    `start` starts the process, or returns None if another process has started it already, as `is_elsewhere`
    reports: a daemon restarts a killed guard, too.
    `fork_server` supervises the fork server, if the node has one.
    """

    def __init__(
        self,
        start: Callable[[], StartedProcess | None],
        is_elsewhere: Callable[[], bool],
        platform: str,
        socket: ParentSocket,
        kept: KeptFolders,
        restart_policy: RestartPolicy,
        fork_server: ForkServerSupervisor | None = None,
    ) -> None:
        self._start = start
        self._is_elsewhere = is_elsewhere
        self._platform = platform
        self._socket = socket
        self._kept = kept
        self._socket_error = ""
        self._restart_policy = restart_policy
        self._fork_server = fork_server
        self._above = Notifier()
        self._pid = 0
        self._process: ProcessHandle | None = None
        self._child: StartedProcess | None = None
        """Process that this parent started last; the exit code of an adopted process is not known."""
        self._beat_ns = 0
        self._ready = False
        self._was_ready = False
        self._leaving = False
        self._asked = False
        self._adopt_until_ns = 0
        """Instant until which a node that ends waits for a notification of a process to adopt and end."""
        self._due_ns: int | None = None

    def run(self) -> int:
        """Supervises until the node ends; returns its exit code."""
        wake, waker = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, self._on_signal)
        # Python writes to the wake-up descriptor only for signals that have a handler
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(waker, warn_on_full_buffer=False)
        poller = select.poll()
        for fd in (wake, self._socket.fileno()):
            poller.register(fd, select.POLLIN)
        try:
            if self._fork_server is None:
                self._begin()
            else:
                self._begin_fork_server(self._fork_server)
                # the fork server's READY starts the process earlier, see `_on_fork_server`
                self._due_ns = self._due_ns or time.monotonic_ns() + round(FORK_SERVER_S * _NS)
            while True:
                code = self._turn(poller, wake)
                if code is not None:
                    return code
        finally:
            signal.set_wakeup_fd(-1)
            self._forget()
            if self._child is not None:
                self._child.close()
            if self._fork_server is not None:
                self._fork_server.close()
            self._above.close()
            for end in (wake, waker):
                os.close(end)

    def _restore_socket(self, poller: select.poll) -> None:
        """Create the notification socket again if its file was removed.

        A process that cannot send its heartbeat would count as hung, and be killed.
        """
        former = self._socket.fileno()
        try:
            if self._socket.restore():
                poller.unregister(former)
                poller.register(self._socket.fileno(), select.POLLIN)
                # heartbeats were lost since the removal, so the silence starts now
                self._beat_ns = time.monotonic_ns()
                self._log("the socket for notifications was removed; made again")
        except (OSError, SwarmError) as error:
            if self._socket_error != str(error):
                self._socket_error = str(error)
                self._log(f"the socket for notifications was removed: {error}")

    def _turn(self, poller: select.poll, wake: int) -> int | None:
        self._restore_socket(poller)
        self._kept.relock()
        process = self._process
        watched = -1 if process is None else process.fileno()
        server = -1 if self._fork_server is None else self._fork_server.fileno()
        for fd in (watched, server):
            if fd >= 0:
                poller.register(fd, select.POLLIN)
        wait_s = self._wait_s()
        began_s = time.monotonic()
        ready = {fd for fd, _ in poller.poll(wait_s * 1000)}
        # the heartbeats of a delay, such as a suspended host, are still in the socket and read below
        if time.monotonic() - began_s - wait_s > LATE_S:
            self._beat_ns = time.monotonic_ns()
        for fd in (watched, server):
            if fd >= 0:
                poller.unregister(fd)
        if wake in ready:
            os.read(wake, RECEIVE_BYTES)
        while (notification := self._socket.receive()) is not None:
            self._on_notification(*notification)
        if self._above.watchdog_s is not None:
            self._above.alive()
        if self._fork_server is not None and server in ready:
            self._log("the fork server ended; started again")
            self._fork_server.on_end()
            self._on_fork_server()
        # a notification above may have replaced the process whose descriptor was polled
        if watched in ready and process is self._process:
            code = self._ended()
            if code is not None and not self._waits_to_adopt():
                return code
        self._reap()
        if self._asked and self._pid == 0 and not self._waits_to_adopt():
            return 0
        self._on_time(time.monotonic_ns())
        return None

    def _waits_to_adopt(self) -> bool:
        """True while this node ends, and a process that a daemon has started would otherwise be left running.

        The notifications of the process have its pid: it is adopted, and ended.
        """
        return self._asked and time.monotonic_ns() < self._adopt_until_ns and self._is_elsewhere()

    def _wait_s(self) -> float:
        """Time until the next deadline, in seconds."""
        now_ns = time.monotonic_ns()
        due = [now_ns + round(BEAT_S / 2 * _NS)]
        if self._due_ns is not None:
            due.append(self._due_ns)
        if self._fork_server is not None and self._fork_server.due_ns is not None:
            due.append(self._fork_server.due_ns)
        if self._above.watchdog_s is not None:
            due.append(now_ns + round(self._above.watchdog_s * _NS))
        return max(0.0, (min(due) - now_ns) / _NS)

    # -- events

    def _on_signal(self, *_: object) -> None:
        self._asked = True
        self._adopt_until_ns = time.monotonic_ns() + round(HUNG_S * _NS)
        self._above.stopping()
        self._signal(signal.SIGTERM)

    def _signal(self, number: int) -> None:
        if self._process is not None:
            self._process.signal(number)  # an ended process is reported by the next poll

    def _on_notification(self, pid: int, fields: dict[str, str]) -> None:
        if self._fork_server is not None and pid == self._fork_server.pid:
            self._fork_server.on_ready()
            self._on_fork_server()
            return
        if self._pid == 0:
            self._follow(pid)
        if pid != self._pid:
            return
        now_ns = self._beat_ns = time.monotonic_ns()
        self._leaving = self._leaving or "STOPPING" in fields
        # an adopted process has sent READY to the former parent
        if "READY" in fields or ("WATCHDOG" in fields and not self._ready):
            self._ready = True
            self._restart_policy.on_ready(now_ns)
            self._above.ready(fields.get("STATUS", ""))
            self._was_ready = True
        elif "STATUS" in fields:
            self._above.status(fields["STATUS"])
        if self._asked:
            self._signal(signal.SIGTERM)  # the process was adopted after the signal arrived

    def _follow(self, pid: int) -> bool:
        try:
            child = self._child
            started = child.started if child is not None and child.pid == pid else 0
            self._process = ProcessHandle(pid, started)
        except OSError:  # ended already, which the caller handles
            return False
        self._pid = pid
        self._due_ns = None
        self._ready = self._leaving = False
        self._beat_ns = time.monotonic_ns()
        return True

    def _ended(self) -> int | None:
        """The process has ended: returns the node's exit code unless the process is restarted."""
        pid, was_ready, leaving = self._pid, self._ready, self._leaving
        how = ExitStatus()
        if self._child is not None and self._child.pid == pid:
            how = self._child.exit_status(ENDED_S)
        self._forget()
        peaceful = how.code == 0 or (not how.known and leaving)
        if peaceful or (self._asked and (not how.known or how.signal == signal.SIGTERM)):
            return 0  # the signal may have come before the process could handle it
        if self._asked and how.signal is not None:
            # the convention of shells for a process that a signal ended
            return 128 + how.signal
        if how.code is not None and (self._asked or not self._was_ready):
            # a process that fails at its start has reported the error, and would fail again in the same way
            return how.code
        now_ns = time.monotonic_ns()
        pause_s = self._restart_policy.on_end(now_ns, killed=was_ready and (not how.known or how.killed))
        if pause_s is None:
            self._log(f"ended: {how}; given up after {self._restart_policy.restarts} restarts")
            return SwarmError.exit_code
        self._log(f"ended: {how}; starts again (restart {self._restart_policy.restarts})")
        self._above.restarted(self._restart_policy.restarts, str(how))
        self._due_ns = now_ns + round(pause_s * _NS)
        return None

    def _reap(self) -> None:
        """Collects orphans, which the kernel assigns to this process if it is the init process of a
        container."""
        while True:
            try:
                # WNOWAIT leaves the own children to `_ended` and the supervisor, which need the exit status
                found = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
                if found is None or found.si_pid in {
                    self._pid,
                    self._fork_server.pid if self._fork_server else 0,
                }:
                    return
                os.waitid(os.P_PID, found.si_pid, os.WEXITED | os.WNOHANG)
            except ChildProcessError:
                return

    def _on_time(self, now_ns: int) -> None:
        if (
            self._fork_server is not None
            and self._fork_server.due_ns is not None
            and now_ns >= self._fork_server.due_ns
        ):
            self._begin_fork_server(self._fork_server)
        if self._due_ns is not None and now_ns >= self._due_ns and not self._asked:
            self._begin()
        elif self._ready and now_ns - self._beat_ns > HUNG_S * _NS:
            self._log(f"no heartbeat for {HUNG_S:g} s: pid {self._pid} is killed")
            # a hung process may take a while to die: SIGKILL is sent again only after the next HUNG_S
            self._beat_ns = now_ns
            self._signal(signal.SIGKILL)

    def _begin(self) -> None:
        if self._child is not None:
            self._child.close()
        try:
            self._child = self._start()
        except OSError as error:
            self._child = None
            self._log(f"cannot be started: {error}")
        if self._child is None or not self._follow(self._child.pid):
            self._due_ns = time.monotonic_ns() + round(ELSEWHERE_S * _NS)

    def _begin_fork_server(self, fork_server: ForkServerSupervisor) -> None:
        try:
            fork_server.begin()
        except OSError as error:
            self._log(f"the fork server cannot be started: {error}")
            self._on_fork_server()

    def _on_fork_server(self) -> None:
        """The fork server is ready or has failed: the first process is started now."""
        if self._pid == 0 and self._child is None:
            self._due_ns = time.monotonic_ns()

    def _forget(self) -> None:
        if self._process is not None:
            self._process.close()
        self._pid, self._process = 0, None
        self._ready = self._leaving = False

    def _log(self, text: str) -> None:
        stamp = time.strftime("%Y-%m-%d %H:%M:%S")
        sys.stderr.write(f"{stamp},000 {self._platform} WARNING swarm.node: {text}\n")
        sys.stderr.flush()
