"""Board `health/ready`: what readiness needs beside the monitor is read, and the result published."""

from typing import Final

from swarmd.health.core.monitor import MonitorCore
from swarmd.health.core.readiness import (
    Picture,
    ReadinessInputs,
    ReadinessRepeater,
    StationLink,
    assess,
)
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.control import RemoteLink
from swarmware.types.health import Readiness
from swarmware.types.mission import MissionState
from swarmware.types.net import Routes
from swarmware.types.vehicle import Pose

ROUTES_S: Final = 5.0
"""Maximum age of the table of routes, which is written every second."""
ESTIMATORS: Final = frozenset({"navigator", "estimator"})
"""Services that estimate the pose."""


class ReadinessBoard:
    """Assesses at each look of the monitor whether the vehicle may be armed."""

    def __init__(self, module: Module, monitor: MonitorCore) -> None:
        self._module = module
        self._monitor = monitor
        self._estimates = not ESTIMATORS.isdisjoint(module.node.config.services)
        self._pose = module.reader("nav/pose", Pose)
        self._remote = module.reader("vehicle/remote", RemoteLink)
        self._routes = module.reader("net/routes", Routes)
        self._missions = module.readers("/*/mission/state", MissionState)
        self._stations: set[str] = set()
        """Ground stations by name, once one has published its kind."""
        self._link = StationLink()
        self._repeater = ReadinessRepeater()
        self._board: BoardWriter[Readiness] = module.writer(
            "health/ready",
            Readiness,
            rate_hz=1.0,
            link="notify",
            log="all",
            description="Whether the vehicle may be armed, and what is not ready",
        )

    def update(self, now_ns: int) -> None:
        """Assess the present inputs; publish a change at once, the same again once a second."""
        monitor = self._monitor
        picture = Picture(
            now_ns,
            self._surroundings(now_ns),
            {age.path: age for age in monitor.ages()},
            monitor.limits(),
            monitor.faults.confirmed(),
        )
        found = assess(picture)
        if self._repeater.due(found, now_ns):
            self._board.write(found, now_ns)

    def _surroundings(self, now_ns: int) -> ReadinessInputs:
        self._look_for_stations(now_ns)
        remote = self._remote.value
        return ReadinessInputs(
            estimates=self._estimates,
            pose_age_s=None if self._pose.value is None else self._pose.age_s,
            station_s=self._link.silent_s(now_ns),
            remote_linked=remote.linked if remote is not None and self._remote.alive else None,
        )

    def _look_for_stations(self, now_ns: int) -> None:
        routes, age_s = self._routes.value, self._routes.age_s
        if routes is None or age_s is None or age_s > ROUTES_S:
            return
        reached = {route.platform for route in routes.routes}
        for platform in reached - self._stations:
            state = self._missions[platform].value if platform in self._missions else None
            if state is not None and state.kind == PlatformKind.GCS:
                self._stations.add(platform)
        if not self._stations.isdisjoint(reached):
            self._link.on_reached(now_ns)
