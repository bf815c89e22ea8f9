"""The core of flight control, which computes actuator outputs from measurements and set-points."""

import math
from typing import Final

import msgspec

from swarmd.hal.core.flight.attitude_filter import AttitudeFilter
from swarmd.hal.core.flight.control_law import ControlLaw, HoverLaw
from swarmd.hal.core.flight.fixed_wing_controller import FixedWingController
from swarmd.hal.core.flight.flight_state import FlightState
from swarmd.hal.core.flight.flight_watch import FlightStep, FlightWatch, tilt
from swarmd.hal.core.flight.helicopter_controller import HelicopterController
from swarmd.hal.core.flight.hover_controller import MultirotorController
from swarmd.hal.core.flight.motion_filter import MotionFilter
from swarmware.geometry.attitude import Vector
from swarmware.geometry.geodesy import ORIGIN_ACC_M
from swarmware.model.airframe import Airframe, MultirotorAirframe
from swarmware.model.fixed_wing_airframe import FixedWingAirframe
from swarmware.model.helicopter_airframe import HelicopterAirframe
from swarmware.types.chassis import ActuatorOutputs
from swarmware.types.vehicle import GnssFix, Imu, Setpoint


class ImuMean:
    """Averages the samples since the last mean, so that vibrations do not alias into a slower rate."""

    __slots__ = ("_count", "_sums", "_yaw_rad")

    def __init__(self) -> None:
        self._sums = [0.0] * 6
        self._count = 0
        self._yaw_rad: float | None = None

    def add(self, imu: Imu) -> None:
        """Adds a sample to the mean."""
        sums = self._sums
        sums[0] += imu.wx_rad_s
        sums[1] += imu.wy_rad_s
        sums[2] += imu.wz_rad_s
        sums[3] += imu.ax_m_s2
        sums[4] += imu.ay_m_s2
        sums[5] += imu.az_m_s2
        self._count += 1
        self._yaw_rad = imu.yaw_rad

    def take(self, roll_rad: float, pitch_rad: float) -> Imu | None:
        """The mean with the newest heading and this attitude, or None without samples; clears the sums."""
        if self._count == 0:
            return None
        wx, wy, wz, ax, ay, az = (value / self._count for value in self._sums)
        self._sums, self._count = [0.0] * 6, 0
        return Imu(wx, wy, wz, ax, ay, az, self._yaw_rad, roll_rad, pitch_rad)


def between(before: Imu, after: Imu, at_s: float, gap_s: float, held_s: float) -> Imu:
    """Interpolates the sample at an instant of a gap, without a heading.

    Held outputs mean constant moments and thrust, so the rates change linearly while they are held. After the
    motors have stopped the rates stay, and the specific force is the one of free fall.
    Units: `at_s` and `gap_s` since the previous sample; `held_s`: time for which outputs are held.
    """
    # the rates stop changing when the motors do
    share = min(1.0, at_s / min(gap_s, held_s))
    falls = gap_s > held_s
    force = (1.0 if at_s > held_s else 0.0) if falls else share

    def rate(one: float, other: float) -> float:
        return one + (other - one) * share

    def acceleration(one: float, other: float) -> float:
        return one + (other - one) * force

    return Imu(
        rate(before.wx_rad_s, after.wx_rad_s),
        rate(before.wy_rad_s, after.wy_rad_s),
        rate(before.wz_rad_s, after.wz_rad_s),
        acceleration(before.ax_m_s2, after.ax_m_s2),
        acceleration(before.ay_m_s2, after.ay_m_s2),
        acceleration(before.az_m_s2, after.az_m_s2),
    )


_STEP_MAX_S: Final = 0.1
"""Maximum time that is integrated between two samples on the ground."""
_STALE_NS: Final = 200_000_000
"""Age of the newest inertial sample above which the attitude is unknown and no outputs are computed."""
_GAP_PERIODS: Final = 3
"""Number of periods between two samples above which the time between them is a gap."""
_END_S: Final = 0.25
"""Time after the stop of the motors in which thrust may still be measured, as rotors run down and clocks
differ."""
FALL_MAX_S: Final = 1.0
"""Maximum time after the stop of the motors at which a flight is continued; the vehicle then has fallen 5
m."""
_FALL_MAX_M_S2: Final = 5.0
"""Specific force below which a vehicle without thrust is in free fall, about half of gravity."""
_FALL_TILT_RAD: Final = 1.0
"""Tilt above which a falling vehicle is not recovered, because thrust would move it sideways."""
_OFF: Final = ActuatorOutputs()
_STOP: Final = Setpoint(0.0)
_NONE: Final = (0.0, 0.0, 0.0)


class FlightTiming(msgspec.Struct, frozen=True):
    """Times of a flight controller and of its actuators."""

    period_s: float = 0.01
    """Period of the inertial samples and of the control steps."""
    held_s: float = 1.0
    """Time for which the actuators hold their last outputs without new ones, before the motors stop."""


class FlightHandover(msgspec.Struct, frozen=True):
    """State of a flight at the end of the previous process, from which the next process continues it."""

    imu: Imu
    """Last inertial sample, with the estimated attitude."""
    stamp_ns: int
    height_m: float = 0.0
    velocity_m_s: Vector = _NONE


class FlightCore:
    """Filters and control loops of one vehicle, with one control step for each inertial sample.

    After a gap between two samples the core computes the motion in the gap, in which the actuators held their
    outputs, and continues the flight. If the motors stopped in the gap, the flight is continued only if the
    vehicle is falling and its attitude permits a recovery; otherwise `lost` has the reason.
    """

    __slots__ = (
        "_armed",
        "_attitude",
        "_controller",
        "_dt_s",
        "_fresh",
        "_gap_s",
        "_landed",
        "_mean",
        "_motion",
        "_sample",
        "_setpoint",
        "_timing",
        "_touched",
        "imu_ns",
        "lost",
        "watch",
    )

    def __init__(
        self,
        controller: ControlLaw,
        timing: FlightTiming = FlightTiming(),  # noqa: B008  # frozen
        origin_acc_m: float = ORIGIN_ACC_M,
    ) -> None:
        self._controller = controller
        self._timing = timing
        self._attitude = AttitudeFilter()
        self._motion = MotionFilter(origin_acc_m)
        self._mean = ImuMean()
        self._setpoint = _STOP
        self._armed, self._landed = False, True
        self.imu_ns = 0
        """Stamp of the newest inertial sample."""
        self._sample: Imu | None = None
        """The newest inertial sample."""
        self._dt_s = self._gap_s = 0.0
        """Duration of the newest control step, and time between the two newest samples."""
        self._fresh = False
        self._touched = False
        """True after unexpected ground contact, after which the vehicle must be disarmed before it takes
        off."""
        self.lost = ""
        """Reason for which the flight cannot be continued and the motors must stop, or "" if it can."""
        self.watch = FlightWatch(timing.period_s, controller.tilt_limit_rad, timing.held_s)
        """Detector of faults of the flight."""

    @property
    def gap_s(self) -> float:
        """Time between the two newest inertial samples, or 0 after the first sample."""
        return self._gap_s

    @property
    def controller(self) -> ControlLaw:
        """The control law, a cascade of control loops."""
        return self._controller

    def on_handover(self, handover: FlightHandover) -> None:
        """Continues the flight of a process that has ended; the next sample ends a gap."""
        imu = handover.imu
        rates = (imu.wx_rad_s, imu.wy_rad_s, imu.wz_rad_s)
        self._attitude.begin((imu.roll_rad or 0.0, imu.pitch_rad or 0.0, imu.yaw_rad or 0.0), rates)
        self._motion.begin(handover.height_m, handover.velocity_m_s)
        self._sample, self.imu_ns = imu, handover.stamp_ns
        self._armed, self._landed = True, False
        self.watch.on_handover(handover.stamp_ns)

    def on_setpoint(self, setpoint: Setpoint) -> None:
        """Takes a set-point: velocity forward, left and up, and yaw rate."""
        self._setpoint = setpoint

    def on_vehicle(self, *, armed: bool, landed: bool) -> None:
        """Takes the state of the vehicle: motors armed or not, on the ground or not."""
        self._armed, self._landed = armed, landed
        if not armed:
            self._touched, self.lost = False, ""

    def on_gnss(self, fix: GnssFix, stamp_ns: int, now_ns: int) -> None:
        """Takes a position fix."""
        self._motion.on_fix(fix, stamp_ns, now_ns)

    def on_height(self, height_m: float) -> None:
        """Takes the height above the ground, after outlier rejection."""
        self._motion.on_height(height_m)

    def on_imu(self, imu: Imu, stamp_ns: int) -> None:
        """Takes a sample of the inertial unit."""
        # the board is read more often than the unit measures
        if stamp_ns <= self.imu_ns:
            return
        gap_s = (stamp_ns - self.imu_ns) / 1e9
        before, self._sample = self._sample, imu
        self.imu_ns, self._fresh = stamp_ns, True
        self._gap_s = 0.0 if before is None else gap_s
        self._mean.add(imu)
        flies = self._armed and not self._landed
        if before is not None and flies and gap_s > _GAP_PERIODS * self._timing.period_s:
            self._bridge(before, imu, gap_s)
        else:
            self._dt_s = min(gap_s, _STEP_MAX_S)
            self._integrate(imu, self._dt_s, trusted=True)

    def _bridge(self, before: Imu, imu: Imu, gap_s: float) -> None:
        """Integrates a gap in the air, in which the held outputs changed the rates linearly between both
        samples."""
        timing = self._timing
        count = math.ceil(gap_s / timing.period_s)
        for number in range(1, count + 1):
            # integrated in steps of the control period, as if the samples had arrived
            sample = between(before, imu, number * gap_s / count, gap_s, timing.held_s)
            self._integrate(sample, gap_s / count, trusted=False)
        # after the integration: the errors that it made grow with the gap
        self._motion.on_gap(gap_s)
        self._controller.resume()
        self._dt_s = timing.period_s
        # shorter gaps ended before the motors had stopped
        if gap_s > timing.held_s + _END_S:
            self.lost = self._uncatchable(imu, gap_s)

    def _integrate(self, imu: Imu, dt_s: float, *, trusted: bool) -> None:
        """Integrates one sample; `trusted`: the accelerometer may correct the vertical."""
        landed = self._landed
        # on the ground nothing accelerates the vehicle, whatever was commanded last
        accelerates_m_s2 = 0.0 if landed else self._controller.acceleration_m_s2
        turn = _NONE
        if self._controller.follows_nose and not landed:
            turn = self._attitude.turn_m_s2(self._motion.velocity_m_s)
        self._attitude.update(
            imu,
            dt_s,
            landed=landed,
            accelerates_m_s2=accelerates_m_s2 if trusted else math.inf,
            turn_m_s2=turn,
        )
        force = self._attitude.to_map((imu.ax_m_s2, imu.ay_m_s2, imu.az_m_s2))
        self._motion.predict(force, dt_s, landed=landed)

    def _uncatchable(self, imu: Imu, gap_s: float) -> str:
        """Reason not to continue a flight whose motors stopped in a gap, or "" to continue it."""
        force = math.hypot(imu.ax_m_s2, imu.ay_m_s2, imu.az_m_s2)
        tilt_rad = tilt(self.state())
        if gap_s > self._timing.held_s + FALL_MAX_S:
            return f"{gap_s:.2f} s without a step, expected at most {self._timing.held_s + FALL_MAX_S:g} s"
        # it stands on the ground or hangs, and thrust from the held state would throw it
        if force > _FALL_MAX_M_S2:
            return f"{gap_s:.2f} s without a step, and the vehicle does not fall: {force:.1f} m/s² on it"
        if tilt_rad > _FALL_TILT_RAD:
            return f"{gap_s:.2f} s without a step, and a tilt of {math.degrees(tilt_rad):.0f}°"
        return ""

    def state(self) -> FlightState:
        """The estimated state at the newest sample."""
        roll, pitch, yaw = self._attitude.angles_rad()
        motion = self._motion
        return FlightState(
            roll, pitch, yaw, self._attitude.rates_rad_s, motion.position_m, motion.velocity_m_s
        )

    def take_imu(self) -> Imu | None:
        """Mean of the samples since the last call, with the filter's roll and pitch, or None without
        samples."""
        roll, pitch, _ = self._attitude.angles_rad()
        return self._mean.take(roll, pitch)

    def is_blind(self, now_ns: int) -> bool:
        """True if the newest inertial sample is too old to know the attitude."""
        return now_ns - self.imu_ns > _STALE_NS

    def step(self, now_ns: int) -> ActuatorOutputs | None:
        """Outputs for the newest sample, or None if they were computed before or the sample is too old."""
        # each sample gets one step; without a new one the actuators hold their outputs
        if not self._fresh or self.is_blind(now_ns):
            return None
        self._fresh = False
        if not self._armed:
            # integrals from the last flight would tilt the next take-off
            self._controller.reset()
            self.watch.on_disarmed()
            return _OFF
        state, wanted = self.state(), self._setpoint
        if self.watch.on_step(FlightStep(state, self._gap_s, wanted.vz_m_s, self._landed), now_ns):
            self._touched = True
        self._controller.expect_gap(self.watch.expected_gap_s(now_ns))
        if self.lost:
            self.watch.on_lost(self.lost, now_ns)
            return _OFF
        return self._controller.update(
            _STOP if self._touched else wanted, state, landed=self._landed, dt_s=self._dt_s
        )


def flight_timing(airframe: Airframe) -> FlightTiming:
    """Times of the flight controller of an airframe."""
    return FlightTiming(1 / airframe.control_hz, airframe.body.outputs_held_s)


def control_law(airframe: Airframe) -> ControlLaw:
    """Creates the control law of an airframe, with the gains of its file."""
    return FixedWingController(airframe) if isinstance(airframe, FixedWingAirframe) else hover_law(airframe)


def hover_law(airframe: MultirotorAirframe | HelicopterAirframe) -> HoverLaw:
    """Creates the control law of an airframe that can hover."""
    if isinstance(airframe, MultirotorAirframe):
        return MultirotorController(airframe)
    return HelicopterController(airframe)
