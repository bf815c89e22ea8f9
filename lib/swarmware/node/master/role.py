"""Election of the master: a file lock decides, a pidfd reports the holder's death, doorbells report requests.

The kernel drops the lock and readies the pidfd in the same instant, so a stand-by takes over within
milliseconds; a lease in shared memory would have to run out first. A lock survives in a forked child, so no
process that holds one is ever forked (ADR 15).
"""

import asyncio
import fcntl
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import Final

from swarmware.node.master.record import NO_HOLDER, Holder, RecordFile
from swarmware.runtime.backoff import pause_after
from swarmware.runtime.pidfd import start_ticks
from swarmware.runtime.processes import WatchedProcess
from swarmware.transport.shm.lock import held_by_other, try_lock

LOCK_NAME: Final = "master.lock"
RETRY_S: Final = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.2)
"""Short at first: the holder of the lock writes its record within some ten microseconds. The last one is for
a holder that cannot be watched: one of another PID namespace."""

log = logging.getLogger("swarm.master")


class LeaderCandidate:
    """The candidature of one process for the role.

    `ring` wakes all others of the node; when woken, they call `poll`. `on_gained` gets the fencing number.
    """

    def __init__(
        self,
        run_dir: Path,
        label: str,
        *,
        ring: Callable[[], None],
        on_gained: Callable[[int], None],
        on_lost: Callable[[], None],
    ) -> None:
        self._file = RecordFile(run_dir / LOCK_NAME)
        self._label = label
        self._ring = ring
        self._on_gained = on_gained
        self._on_lost = on_lost
        self._loop = asyncio.get_running_loop()
        self._me = (os.getpid(), start_ticks(os.getpid()))
        self._mark = b""
        self._watched: WatchedProcess | None = None
        self._retry: asyncio.TimerHandle | None = None
        self._failures = 0
        self._known_epoch = 0
        """Fencing number in a former file, which was removed."""
        self._closed = False
        self.holding = False
        self.preferred = False

    def start(self) -> None:
        """Start to contend for leadership."""
        self._contend()

    @property
    def holder(self) -> Holder:
        """The process that holds the role."""
        return self._file.holder() or NO_HOLDER

    def poll(self) -> None:
        """The doorbell has rung: the role may have changed hands, or the preferred process may request it."""
        if self._closed:
            return
        if self.holding:
            if not self.preferred and self._requested():
                self._yield()
        elif self._file.mark() != self._mark:
            self._contend()

    def tend(self) -> Path | None:
        """Make the file of the role again if it was removed; its path, or None if it stands.

        The holder does so first, so that the role stays with it. Raises: OSError.
        """
        if self._closed or self._file.stands or (not self.holding and held_by_other(self._file.fd)):
            return None
        former, self._file = self._file, RecordFile(self._file.path)
        held = former.holder() or NO_HOLDER
        present = self.holder
        # The new file begins with epoch 0, and a fencing number must never be given twice.
        self._known_epoch = max(held.epoch, self._known_epoch)
        is_older = present == held or present.epoch < held.epoch
        if self.holding and is_older and try_lock(self._file.fd):
            self._file.write_holder(held)
            self._mark = self._file.mark()
        elif self.holding:  # a process that has joined since holds the role
            self.holding = False
            self._on_lost()
        if not self.holding:
            if self.preferred:
                self._file.request_leadership(*self._me)
            self._contend()
        former.close()
        self._ring()
        return self._file.path

    def volunteer(self, label: str) -> None:
        """Make this the preferred process: another holder yields the role to it."""
        self.preferred = True
        self._label = label
        if self.holding:
            self._file.write_holder(Holder(self.holder.epoch, *self._me, label))
            self._on_gained(self.holder.epoch)
        else:
            self._file.request_leadership(*self._me)
            self._ring()
            self._contend()

    def step_back(self, label: str) -> None:
        """Contend as any other process."""
        self.preferred = False
        self._label = label
        self._withdraw_request()
        if self.holding:
            self._file.write_holder(Holder(self.holder.epoch, *self._me, label))
            self.poll()

    def close(self) -> None:
        """Stop contending; release the role and wake the other processes."""
        if self._closed:
            return
        self._closed = True
        self._unwatch()
        self._withdraw_request()
        if self.holding:
            self._release()
        self._file.close()

    def _requested(self) -> bool:
        """Whether a living preferred process other than this one requests the role."""
        pid, pid_start = self._file.requested_by()
        return pid != 0 and (pid, pid_start) != self._me and start_ticks(pid) == pid_start

    def _withdraw_request(self) -> None:
        if self._file.requested_by() == self._me:
            self._file.request_leadership(0, 0)

    def _contend(self) -> None:
        """Take the role if it is free and not requested, otherwise watch its holder."""
        self._unwatch()
        if self._closed or self.holding:
            return
        if not self.preferred and self._requested() and self.holder.pid == 0:
            # it was released for the preferred process: take it only if that one dies meanwhile
            self._mark = self._file.mark()
            self._watch(*self._file.requested_by())
        elif try_lock(self._file.fd):
            self._take()
        else:
            self._mark = self._file.mark()
            holder = self._file.holder()
            if holder is None or holder.pid == 0:
                self._again()
            else:
                self._watch(holder.pid, holder.pid_start)

    def _take(self) -> None:
        epoch = max(self.holder.epoch, self._known_epoch) + 1
        self.holding = True
        self._withdraw_request()
        self._file.write_holder(Holder(epoch, *self._me, self._label))
        self._mark = self._file.mark()
        log.debug("%s is master, epoch %d", self._label, epoch)
        self._failures = 0
        self._ring()
        self._on_gained(epoch)
        self._loop.call_soon(self.poll)  # the preferred process may have rung before we listened

    def _yield(self) -> None:
        self._release()
        self._contend()

    def _release(self) -> None:
        self.holding = False
        self._on_lost()
        # Written before the lock is released: later the record may belong to the next holder.
        self._file.write_holder(Holder(self.holder.epoch, 0, 0, self._label))
        self._mark = self._file.mark()
        fcntl.flock(self._file.fd, fcntl.LOCK_UN)
        self._ring()

    def _watch(self, pid: int, pid_start: int) -> None:
        """Contends again when this process dies."""
        try:
            process = WatchedProcess(pid, self._contend)
        except OSError:
            # it is dead already, or of another PID namespace: only the lock shows which
            self._again()
            return
        # The pid was reused: the watched process would not be the holder.
        if start_ticks(pid) != pid_start:
            process.close()
            self._again()
            return
        self._failures = 0
        self._watched = process

    def _again(self) -> None:
        self._failures += 1
        self._retry = self._loop.call_later(pause_after(self._failures, RETRY_S), self._contend)

    def _unwatch(self) -> None:
        if self._retry is not None:
            self._retry.cancel()
            self._retry = None
        if self._watched is not None:
            self._watched.close()
            self._watched = None
