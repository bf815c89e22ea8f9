"""The core of flight control: measurements and set-points in, outputs of the actuators out."""

from typing import Final

from swarmd.hal.core.flight.attitude_filter import AttitudeFilter
from swarmd.hal.core.flight.control_law import ControlLaw, HoverLaw
from swarmd.hal.core.flight.fixed_wing_controller import FixedWingController
from swarmd.hal.core.flight.flight_state import FlightState
from swarmd.hal.core.flight.helicopter_controller import HelicopterController
from swarmd.hal.core.flight.imu_mean import ImuMean
from swarmd.hal.core.flight.motion_filter import MotionFilter
from swarmd.hal.core.flight.multirotor_controller import MultirotorController
from swarmware.geometry.geodesy import ORIGIN_ACC_M
from swarmware.model.airframe import Airframe, MultirotorAirframe
from swarmware.model.fixed_wing_airframe import FixedWingAirframe
from swarmware.model.helicopter_airframe import HelicopterAirframe
from swarmware.types.chassis import ActuatorOutputs
from swarmware.types.vehicle import GnssFix, Imu, Setpoint

_STEP_MAX_S: Final = 0.1
"""Longest time between two samples that is integrated."""
_STALE_NS: Final = 200_000_000
"""Age of the newest inertial sample above which no outputs are computed: attitude is not known any more."""
_OFF: Final = ActuatorOutputs()
_STOP: Final = Setpoint(0.0)
_NONE: Final = (0.0, 0.0, 0.0)


class FlightCore:
    """Filters and cascade of one vehicle; one control step for each sample of the inertial unit."""

    __slots__ = (
        "_armed",
        "_attitude",
        "_controller",
        "_dt_s",
        "_fresh",
        "_landed",
        "_mean",
        "_motion",
        "_setpoint",
        "imu_ns",
    )

    def __init__(self, controller: ControlLaw, origin_acc_m: float = ORIGIN_ACC_M) -> None:
        self._controller = controller
        self._attitude = AttitudeFilter()
        self._motion = MotionFilter(origin_acc_m)
        self._mean = ImuMean()
        self._setpoint = _STOP
        self._armed, self._landed = False, True
        self.imu_ns = 0
        """Stamp of the newest inertial sample."""
        self._dt_s = 0.0
        self._fresh = False

    @property
    def controller(self) -> ControlLaw:
        """The cascade of control loops."""
        return self._controller

    def on_setpoint(self, setpoint: Setpoint) -> None:
        """Takes a set-point: velocity and yaw rate, forward, left and up."""
        self._setpoint = setpoint

    def on_vehicle(self, *, armed: bool, landed: bool) -> None:
        """Takes whether the motors are armed, and the vehicle is on the ground."""
        self._armed, self._landed = armed, landed

    def on_gnss(self, fix: GnssFix, stamp_ns: int, now_ns: int) -> None:
        """Takes a position fix."""
        self._motion.on_fix(fix, stamp_ns, now_ns)

    def on_height(self, height_m: float) -> None:
        """Takes the height above the ground, after outlier rejection."""
        self._motion.on_height(height_m)

    def on_imu(self, imu: Imu, stamp_ns: int) -> None:
        """Takes a sample of the inertial unit."""
        if stamp_ns <= self.imu_ns:
            return
        dt_s = min((stamp_ns - self.imu_ns) / 1e9, _STEP_MAX_S)
        self.imu_ns, self._dt_s, self._fresh = stamp_ns, dt_s, True
        self._mean.add(imu)
        landed = self._landed
        accelerates_m_s2 = 0.0 if landed else self._controller.acceleration_m_s2
        turn = _NONE
        if self._controller.follows_nose and not landed:
            turn = self._attitude.turn_m_s2(self._motion.velocity_m_s)
        self._attitude.update(imu, dt_s, landed=landed, accelerates_m_s2=accelerates_m_s2, turn_m_s2=turn)
        force = self._attitude.to_map((imu.ax_m_s2, imu.ay_m_s2, imu.az_m_s2))
        self._motion.predict(force, dt_s, landed=landed)

    def state(self) -> FlightState:
        """The estimated state at the newest sample."""
        roll, pitch, yaw = self._attitude.angles_rad()
        motion = self._motion
        return FlightState(
            roll, pitch, yaw, self._attitude.rates_rad_s, motion.position_m, motion.velocity_m_s
        )

    def take_imu(self) -> Imu | None:
        """Mean of the samples since the last call, with roll and pitch of the filter; None: no samples."""
        roll, pitch, _ = self._attitude.angles_rad()
        return self._mean.take(roll, pitch)

    def is_blind(self, now_ns: int) -> bool:
        """Whether the newest inertial sample is too old to know the attitude."""
        return now_ns - self.imu_ns > _STALE_NS

    def step(self, now_ns: int) -> ActuatorOutputs | None:
        """The outputs for the newest sample; None when they were computed, or it is too old."""
        if not self._fresh or self.is_blind(now_ns):
            return None
        self._fresh = False
        if not self._armed:
            self._controller.reset()
            return _OFF
        return self._controller.update(self._setpoint, self.state(), landed=self._landed, dt_s=self._dt_s)


def control_law(airframe: Airframe) -> ControlLaw:
    """The cascade of control loops of an airframe, with the gains of its file."""
    return FixedWingController(airframe) if isinstance(airframe, FixedWingAirframe) else hover_law(airframe)


def hover_law(airframe: MultirotorAirframe | HelicopterAirframe) -> HoverLaw:
    """The cascade of an airframe that hovers."""
    if isinstance(airframe, MultirotorAirframe):
        return MultirotorController(airframe)
    return HelicopterController(airframe)
