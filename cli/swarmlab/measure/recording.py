"""The nodes' logs as values on one time axis: true seconds since the command."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final, TypeVar

import msgspec
import numpy as np

from swarmlab.measure.clocks import ClockTruth
from swarmlab.measure.tracks import VehicleTrack
from swarmware.errors import WireError
from swarmware.recorder.query import FolderSource, Query
from swarmware.types import registry
from swarmware.types.vehicle import Pose

T = TypeVar("T", bound=msgspec.Struct)

TRUTH: Final = "sim/truth"


class LoggedValue(msgspec.Struct, frozen=True):
    """One value that a node has logged."""

    t_s: float
    """True time since the command."""
    stamp_ns: int
    """Stamp on the node's own clock."""
    payload: bytes


class QueueSpan(msgspec.Struct):
    """Sequence numbers of one queue of a logger, to find gaps."""

    first: int
    last: int
    entries: int


class Recording:
    """All logs of a run, read once; values of the selected paths are stored, others counted.

    `origin_ns` is the true time of the command (the machine's CLOCK_MONOTONIC).
    """

    def __init__(
        self,
        folders: Mapping[str, Path],
        clocks: Mapping[str, ClockTruth],
        origin_ns: int,
        wanted: Iterable[str],
    ) -> None:
        self.clocks = dict(clocks)
        self.origin_ns = origin_ns
        self.entries = 0
        """Number of entries in all logs."""
        self.missing = 0
        """Number of missing entries in the queues of the logs."""
        self._values: dict[tuple[str, str], list[LoggedValue]] = {}
        kept = frozenset(wanted)
        for platform, folder in folders.items():
            self._read(platform, folder, kept)

    def _read(self, platform: str, folder: Path, kept: frozenset[str]) -> None:
        clock, origin_ns = self.clocks[platform].clock, self.origin_ns
        queues: dict[str, QueueSpan] = {}
        for entry in FolderSource([folder]).entries(Query()):
            self.entries += 1
            queue = queues.setdefault(entry.queue, QueueSpan(entry.sequence, entry.sequence, 0))
            queue.last = max(queue.last, entry.sequence)
            queue.entries += 1
            # a logger also records mirrors of other platforms, whose stamps are on other clocks
            if entry.path in kept and entry.platform == platform:
                t_s = (clock.to_mono_ns(entry.stamp_ns) - origin_ns) / 1e9
                value = LoggedValue(t_s, entry.stamp_ns, entry.payload)
                self._values.setdefault((platform, entry.path), []).append(value)
        self.missing += sum(max(0, q.last - q.first + 1 - q.entries) for q in queues.values())

    def values(self, platform: str, path: str, cls: type[T]) -> list[tuple[float, T]]:
        """Values in the order of their stamps; undecodable values are skipped."""
        found = []
        for value in sorted(self._values.get((platform, path), []), key=lambda value: value.stamp_ns):
            try:
                found.append((value.t_s, registry.decode(cls, value.payload)))
            except WireError:
                continue
        return found

    def track(self, platform: str) -> VehicleTrack:
        """The true path of a vehicle."""
        truth = self.values(platform, TRUTH, Pose)
        t_s = np.array([at_s for at_s, _ in truth])
        xyz = np.array([(pose.x_m, pose.y_m, pose.z_m) for _, pose in truth]).reshape(-1, 3)
        yaw = np.array([pose.yaw_rad for _, pose in truth])
        # a value that is recorded twice would give a zero interval for the interpolation
        order = np.unique(t_s, return_index=True)[1]
        return VehicleTrack(platform, t_s[order], xyz[order], yaw[order])
