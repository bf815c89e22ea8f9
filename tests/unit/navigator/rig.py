"""A navigator with simulated sensors, in virtual time."""

import math

from swarmd.navigator.config import Config
from swarmd.navigator.core.air_controller import AirController
from swarmd.navigator.core.ground_controller import GroundController
from swarmd.navigator.core.navigator import NavigatorCore, NavigatorOutput
from swarmware.geometry.geodesy import LocalMap, Origin
from swarmware.types.navigation import Goal, NavState, NavStatus
from swarmware.types.vehicle import GnssFix, Imu, Pose, Setpoint, VehicleState

ORIGIN = Origin(lat_deg=48.0, lon_deg=11.0)


STEP_NS = 50_000_000


class Rig:
    """A navigator with exact sensors, and a vehicle that follows set-points without delay."""

    def __init__(self, kind: str = "uav", name: str = "uav1", z_m: float = 8.0) -> None:
        pilot = AirController(Config()) if kind == "uav" else GroundController(Config())
        self.navigator = NavigatorCore(Config(), name, ORIGIN, pilot)
        self.map = LocalMap(ORIGIN)
        self.truth = Pose.planar(0.0, 0.0, z_m if kind == "uav" else 0.0)
        self.now_ns = 1_000_000_000
        self.gnss = True
        self.held = False
        self.status = NavStatus(-1, NavState.IDLE)
        self.said: list[NavStatus] = []
        self.last = NavigatorOutput(None, Setpoint(0.0), None)
        self.neighbours: dict[str, Pose] = {}
        self.vehicle(True, z_m <= 0.0 or kind != "uav")

    def vehicle(self, armed: bool, landed: bool) -> None:
        self.navigator.on_vehicle(VehicleState(armed, landed))

    def goal(self, goal: Goal) -> "Rig":
        self.navigator.on_goal(goal, self.now_ns)
        return self

    def go(self, seconds: float) -> "Rig":
        for _ in range(round(seconds * 1e9 / STEP_NS)):
            self.now_ns += STEP_NS
            t = self.truth
            self.navigator.on_imu(Imu(0.0, 0.0, t.wz_rad_s, 0.0, 0.0, 9.80665, t.yaw_rad), self.now_ns)
            if self.gnss:
                fix = GnssFix(*self.map.to_wgs84(t.x_m, t.y_m, t.z_m), 0.02, 12)
                self.navigator.on_gnss(fix, self.now_ns)
            for name, pose in self.neighbours.items():
                self.navigator.on_neighbour(name, pose, self.now_ns)
            self.last = self.navigator.step(self.now_ns)
            if self.last.status is not None:
                self.status = self.last.status
                self.said.append(self.status)
            self._obey(self.last.setpoint)
        return self

    def _obey(self, wanted: Setpoint) -> None:
        if self.held:
            wanted = Setpoint(0.0)
        t, dt = self.truth, STEP_NS / 1e9
        yaw = t.yaw_rad + wanted.wz_rad_s * dt
        vx = wanted.vx_m_s * math.cos(yaw) - wanted.vy_m_s * math.sin(yaw)
        vy = wanted.vx_m_s * math.sin(yaw) + wanted.vy_m_s * math.cos(yaw)
        z = max(0.0, t.z_m + wanted.vz_m_s * dt)
        self.truth = Pose.planar(
            t.x_m + vx * dt, t.y_m + vy * dt, z, yaw, (vx, vy, wanted.vz_m_s), wanted.wz_rad_s
        )

    @property
    def stands(self) -> bool:
        s = self.last.setpoint
        return max(abs(s.vx_m_s), abs(s.vy_m_s), abs(s.vz_m_s), abs(s.wz_rad_s)) < 0.05
