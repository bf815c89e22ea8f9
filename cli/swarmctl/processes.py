"""Processes of a lab: who they are, whether they live, how they end."""

import os
import select
import signal
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

MARK: Final = "SWARM_LAB"
"""Environment variable that every process of a lab inherits; its value is the lab's folder."""
NODE_MARK: Final = "SWARM_LAB_NODE"
"""The same for a node's processes; its value is the node's folder."""


class ProcessIdentity(msgspec.Struct, frozen=True, order=True):
    """A process for good: pids come back, a pid with its start time does not."""

    pid: int
    start_ticks: int
    """Clock ticks since boot, field 22 of /proc/PID/stat."""

    def alive(self) -> bool:
        """Whether it runs; one that only waits to be collected by its parent does not."""
        return self.pid > 0 and _stat(self.pid) == (self.start_ticks, True)

    def send(self, number: signal.Signals) -> None:
        """A signal to this process and to no later one of its pid."""
        with suppress(ProcessLookupError, PermissionError):
            fd = os.pidfd_open(self.pid)
            try:
                if self.alive():
                    signal.pidfd_send_signal(fd, number)
            finally:
                os.close(fd)


def _stat(pid: int) -> tuple[int, bool] | None:
    """Start time and whether it still runs; None when there is no such process."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text("utf-8", "replace")
    except OSError:
        return None
    fields = text[text.rindex(")") + 2 :].split()  # the name before may hold blanks and brackets
    return int(fields[19]), fields[0] not in {"Z", "X"}


def identity(pid: int) -> ProcessIdentity:
    """The process that has this pid now; a start time of 0 when there is none."""
    found = _stat(pid)
    return ProcessIdentity(pid, found[0] if found else 0)


def marked(mark: str, variable: str = MARK) -> list[ProcessIdentity]:
    """All processes of a lab, or of one node: what was started, and what those started."""
    return [who for who, found in _marks(variable) if found == mark]


def by_mark(variable: str) -> dict[str, list[ProcessIdentity]]:
    """Mark → its processes, in one look at all processes of the machine."""
    found: dict[str, list[ProcessIdentity]] = {}
    for who, mark in _marks(variable):
        found.setdefault(mark, []).append(who)
    return found


def marks() -> set[str]:
    """Marks of all labs of this user of which a process runs."""
    return {mark for _, mark in _marks(MARK)}


def _marks(variable: str) -> Iterator[tuple[ProcessIdentity, str]]:
    """Every other living process that carries the variable, and what it says."""
    head = f"{variable}=".encode()
    for entry in Path("/proc").iterdir():
        if not entry.name.isdecimal() or int(entry.name) == os.getpid():
            continue
        try:
            environment = (entry / "environ").read_bytes()
        except OSError:
            continue  # gone meanwhile, or another user's
        for word in environment.split(b"\0"):
            if word.startswith(head) and (who := identity(int(entry.name))).alive():
                yield who, os.fsdecode(word[len(head) :])


def wait_gone(processes: Iterable[ProcessIdentity], timeout_s: float) -> list[ProcessIdentity]:
    """Waits until they have ended, woken by the kernel; returns those that have not.

    A process whose parent never collects it counts as ended.
    """
    poller = select.poll()
    fds: dict[int, ProcessIdentity] = {}
    try:
        for process in processes:
            with suppress(ProcessLookupError):
                if process.alive():
                    fd = os.pidfd_open(process.pid)
                    fds[fd] = process
                    poller.register(fd, select.POLLIN)
        deadline = time.monotonic() + timeout_s
        while fds and (left := deadline - time.monotonic()) > 0:
            for fd, _ in poller.poll(left * 1000):
                poller.unregister(fd)
                os.close(fd)
                del fds[fd]
        return [process for process in fds.values() if process.alive()]
    finally:
        for fd in fds:
            os.close(fd)


def end(first: Iterable[ProcessIdentity], mark: str, *, grace_s: float = 8.0) -> int:
    """Ends a lab's processes, nodes first and in peace; returns how many had to be forced.

    A node's main process gets SIGTERM alone: it ends its own children in their order.
    """
    nodes = [process for process in first if process.alive()]
    for process in nodes:
        process.send(signal.SIGTERM)
    wait_gone(nodes, grace_s)
    rest = marked(mark)
    for process in rest:
        process.send(signal.SIGTERM)
    wait_gone(rest, 2.0 if rest else 0.0)
    forced = {*marked(mark), *(process for process in nodes if process.alive())}
    for process in forced:
        process.send(signal.SIGKILL)
    wait_gone(forced, 5.0)
    return len(forced)
