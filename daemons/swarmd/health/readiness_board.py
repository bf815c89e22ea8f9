"""Board `health/ready`: reads the further inputs of readiness, and publishes the result."""

from typing import Final

from swarmd.health.core.monitor import MonitorCore
from swarmd.health.core.readiness import (
    Picture,
    ReadinessInputs,
    ReadinessRepeater,
    assess,
)
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.control import RemoteLink
from swarmware.types.fence import FenceState
from swarmware.types.health import Readiness
from swarmware.types.reaction import MissionWatch
from swarmware.types.vehicle import Pose

ESTIMATORS: Final = frozenset({"navigator", "estimator"})
"""Names of the services that estimate the pose."""


class ReadinessBoard:
    """Assesses whether the vehicle may be armed, each time the monitor has read its inputs."""

    def __init__(self, module: Module, monitor: MonitorCore) -> None:
        self._module = module
        self._monitor = monitor
        self._estimates = not ESTIMATORS.isdisjoint(module.node.config.services)
        self._pose = module.reader("nav/pose", Pose)
        self._remote = module.reader("vehicle/remote", RemoteLink)
        self._fence = module.reader("nav/fence", FenceState)
        self._watch = module.reader("mission/watch", MissionWatch)
        self._repeater = ReadinessRepeater()
        self._board: BoardWriter[Readiness] = module.writer(
            "health/ready",
            Readiness,
            rate_hz=1.0,
            link="notify",
            log="all",
            description="Whether the vehicle may be armed, and the items that are not ready",
        )

    def update(self, now_ns: int) -> None:
        """Assesses the present inputs; publishes a change at once, and an unchanged result once a second."""
        monitor = self._monitor
        picture = Picture(
            now_ns,
            self._inputs(),
            {age.path: age for age in monitor.ages()},
            monitor.limits(),
            monitor.faults.confirmed(),
        )
        found = assess(picture)
        if self._repeater.due(found, now_ns):
            self._board.write(found, now_ns)

    def _inputs(self) -> ReadinessInputs:
        remote, watch = self._remote.value, self._watch.value
        return ReadinessInputs(
            estimates=self._estimates,
            pose_age_s=None if self._pose.value is None else self._pose.age_s,
            station=watch.station if watch is not None and self._watch.alive else None,
            fence=self._fence.value,
            fence_age_s=self._fence.age_s or 0.0,
            remote_linked=remote.linked if remote is not None and self._remote.alive else None,
        )
