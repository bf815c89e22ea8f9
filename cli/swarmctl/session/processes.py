"""Processes of a lab: identity, state and termination.

psutil finds the processes by their environment. Identity, signals and waiting use start ticks and pidfds of
the kernel: psutil's creation times move when the wall clock is set, so another process could not compare
them, and its `wait_procs` polls.
"""

import os
import select
import signal
import time
from collections.abc import Iterable, Iterator
from contextlib import closing, suppress
from typing import Final

import msgspec

from swarmware.runtime.pidfd import ProcessHandle, lives, start_ticks

MARK: Final = "SWARM_LAB"
"""Environment variable that every process of a lab inherits; its value is the lab's folder."""
NODE_MARK: Final = "SWARM_LAB_NODE"
"""Environment variable that the processes of one node inherit; its value is the node's folder."""


class ProcessIdentity(msgspec.Struct, frozen=True, order=True):
    """One process; the kernel reuses a pid, but never with the same start time."""

    pid: int
    start_ticks: int
    """Start in clock ticks since boot, or 0 if the process never existed."""

    def alive(self) -> bool:
        """Whether the process runs; a zombie does not."""
        return lives(self.pid, self.start_ticks)

    def handle(self) -> ProcessHandle:
        """Handle of this process.

        Raises: ProcessLookupError when it has ended, OSError when it cannot be watched from here.
        """
        if not self.start_ticks:
            raise ProcessLookupError(f"process {self.pid}: there was no such process")
        return ProcessHandle(self.pid, self.start_ticks)

    def send(self, number: signal.Signals) -> None:
        """Sends a signal to this process, never to a later one of the same pid."""
        with suppress(ProcessLookupError, PermissionError), closing(self.handle()) as process:
            process.signal(number)


def identity(pid: int) -> ProcessIdentity:
    """The process that has this pid now."""
    return ProcessIdentity(pid, start_ticks(pid))


def marked(mark: str, variable: str = MARK) -> list[ProcessIdentity]:
    """All processes of a lab or node, including their descendants."""
    return [process for process, found in _marks(variable) if found == mark]


def by_mark(variable: str) -> dict[str, list[ProcessIdentity]]:
    """The processes of each mark, from one pass over all processes of the machine."""
    found: dict[str, list[ProcessIdentity]] = {}
    for process, mark in _marks(variable):
        found.setdefault(mark, []).append(process)
    return found


def marks() -> set[str]:
    """Marks of all labs of this user with a running process."""
    return {mark for _, mark in _marks(MARK)}


def _marks(variable: str) -> Iterator[tuple[ProcessIdentity, str]]:
    """Every other living process that carries the variable, and its value."""
    import psutil  # most commands do not need it

    for pid in psutil.pids():
        if pid == os.getpid():
            continue
        try:
            mark = psutil.Process(pid).environ().get(variable)
        except psutil.Error:
            continue  # it has ended, or is another user's
        # the pid may have been used again since its environment was read
        if mark is not None and (process := identity(pid)).alive():
            yield process, mark


def wait_gone(processes: Iterable[ProcessIdentity], timeout_s: float) -> list[ProcessIdentity]:
    """Waits until the processes have ended, woken by the kernel; returns the processes that still run.

    A zombie counts as ended.
    """
    poller = select.poll()
    running: dict[int, tuple[ProcessHandle, ProcessIdentity]] = {}
    try:
        for process in processes:
            with suppress(ProcessLookupError):
                handle = process.handle()
                running[handle.fileno()] = handle, process
                poller.register(handle, select.POLLIN)
        deadline = time.monotonic() + timeout_s
        while running and (left := deadline - time.monotonic()) > 0:
            for fd, _ in poller.poll(left * 1000):
                poller.unregister(fd)
                running.pop(fd)[0].close()
        return [process for _, process in running.values() if process.alive()]
    finally:
        for handle, _ in running.values():
            handle.close()


def end(first: Iterable[ProcessIdentity], mark: str, *, grace_s: float = 8.0) -> int:
    """Ends the processes of a lab, nodes first, with SIGTERM before SIGKILL; returns how many were killed.

    The main process of a node gets SIGTERM alone: it ends its children in their order.
    """
    nodes = [process for process in first if process.alive()]
    for process in nodes:
        process.send(signal.SIGTERM)
    wait_gone(nodes, grace_s)
    rest = marked(mark)  # after the nodes, whose guards would restart a process that ended before them
    for process in rest:
        process.send(signal.SIGTERM)
    wait_gone(rest, 2.0 if rest else 0.0)
    # nodes as well: a process whose environment cannot be read any more carries no mark
    forced = {*marked(mark), *(process for process in nodes if process.alive())}
    for process in forced:
        process.send(signal.SIGKILL)
    wait_gone(forced, 5.0)
    return len(forced)
