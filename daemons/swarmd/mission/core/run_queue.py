"""The runs that a platform keeps: by priority, then in the order in which they were issued."""

from collections.abc import Iterator
from typing import Final

import msgspec

from swarmd.mission.core.executor import MissionExecutor
from swarmd.mission.core.run import Run
from swarmware.errors import Conflict, NotFound
from swarmware.types.mission import MissionPhase, QueuedMission

QUEUE_LIMIT: Final = 8
"""Maximum number of runs that wait or are suspended; all are named in the beacon."""
WAITING: Final = "waiting"


class QueuedRun(msgspec.Struct):
    """A run and its executor, which begins or continues when the run is called."""

    run: Run
    executor: MissionExecutor
    priority: int
    since_ns: int
    """When it was accepted."""

    @property
    def rank(self) -> tuple[int, int]:
        """Place in the queue: lower is earlier. All members compute the same, so they call runs alike."""
        return -self.priority, self.run.epoch

    @property
    def is_waiting(self) -> bool:
        """Whether the run has not begun."""
        return self.executor.phase is MissionPhase.IDLE

    def entry(self, why: str) -> QueuedMission:
        """Row of the queue as operators see it."""
        run, phase = self.run, self.executor.phase
        state = WAITING if self.is_waiting else phase.value
        return QueuedMission(run.epoch, run.name, run.role, self.priority, state, self.since_ns, run.by, why)


class RunQueue:
    """Runs that wait or are suspended."""

    def __init__(self) -> None:
        self._runs: dict[int, QueuedRun] = {}

    def __iter__(self) -> Iterator[QueuedRun]:
        return iter(sorted(self._runs.values(), key=lambda one: one.rank))

    def __len__(self) -> int:
        return len(self._runs)

    @property
    def epochs(self) -> tuple[int, ...]:
        """Numbers of the runs, in their order."""
        return tuple(one.run.epoch for one in self)

    @property
    def first(self) -> QueuedRun | None:
        """The run that is called next."""
        return next(iter(self), None)

    def find(self, epoch: int) -> QueuedRun | None:
        """The run of this number."""
        return self._runs.get(epoch)

    def check_room(self) -> None:
        """Check that another run may wait. Raises: Conflict."""
        if len(self._runs) >= QUEUE_LIMIT:
            raise Conflict(f"{QUEUE_LIMIT} missions wait already; `swarmctl mission cancel ID` removes one")

    def put(self, one: QueuedRun) -> None:
        """Put a run into the queue."""
        self._runs[one.run.epoch] = one

    def take(self, epoch: int) -> QueuedRun:
        """Take a run out of the queue. Raises: NotFound."""
        if epoch not in self._runs:
            raise NotFound(f"run {epoch}: not in the queue")
        return self._runs.pop(epoch)
