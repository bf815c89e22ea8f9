"""Controller of a fixed-wing aircraft: loops of course, airspeed and climb above loops of roll and pitch."""

import math
from typing import Final

import msgspec

from swarmd.hal.core.flight.control_law import changed
from swarmd.hal.core.flight.flight_state import FlightState
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.model.fixed_wing_airframe import AIR_DENSITY_KG_M3, FixedWingAirframe
from swarmware.types.chassis import ActuatorOutputs
from swarmware.types.vehicle import Setpoint

_LIFT_M_S: Final = 0.1
"""Commanded climb rate above which a landed aircraft is launched."""
_TILT_MARGIN_RAD: Final = 0.5
"""Tilt beyond the maximum bank that counts as a fault, more than a gust causes."""
_STOP_M_S: Final = 0.2
"""Commanded speed below which the aircraft loiters."""
_ATTACK_MAX_RATIO: Final = 0.8
"""Ratio of the maximum commanded angle of attack to the stall angle."""
_STALL_MARGIN: Final = 1.08
"""Minimum ratio of the airspeed to the stall speed at the load factor of a commanded turn."""
_LOAD_MIN: Final = 1.05
"""Load factor of the flattest turn, always permitted, at a bank of 0.3 rad."""
_SLOW_RAD_S_M: Final = 0.1
"""Decrease of the maximum pitch per m/s below the minimum airspeed."""
_AHEAD_M: Final = 3.0
"""Maximum distance of the commanded height from the aircraft's height."""
_TRIM_MAX: Final = 0.3
"""Bound of the pitch loop's integral, in elevator."""
_LEVEL_RAD: Final = 0.1
"""Maximum bank in the flare and after the launch, when the wings are near the ground."""
_CLIMB_OUT_M: Final = 8.0
"""Height below which a climbing aircraft keeps its wings nearly level."""
_CLIMB_MAX_RAD: Final = 0.2
"""Bound of the climb loop's integral, in pitch."""
_THROTTLE_TRIM_MAX: Final = 0.5
"""Bound of the airspeed loop's integral."""
_LAUNCH: Final = ActuatorOutputs((1.0,), (0.0, 0.0, 0.0))
_GROUND: Final = ActuatorOutputs((0.0,), (0.0, 0.0, 0.0))


class FixedWingController:
    """Cascade of a fixed-wing aircraft.

    A velocity set-point is a course, an airspeed between minimum and maximum, and a climb rate. Without a
    velocity the aircraft flies a circle. Source: Beard and McLain 2012, "Small Unmanned Aircraft", chapter 6.
    """

    __slots__ = ("_airframe", "_climb", "_gains", "_height_m", "_pitch", "_roll", "_throttle")

    follows_nose: Final = True
    acceleration_m_s2: Final = 0.0
    """Always 0, because only turns accelerate an aircraft horizontally, and their acceleration is known."""

    def __init__(self, airframe: FixedWingAirframe) -> None:
        self._airframe = airframe
        self._gains = airframe.gains
        self._pitch = 0.0
        """Integral of the pitch loop, in elevator."""
        self._roll = 0.0
        """Integral of the roll loop, in aileron."""
        self._climb = 0.0
        """Integral of the climb loop, in rad of pitch."""
        self._height_m: float | None = None
        """Commanded height, or None for the present height."""
        self._throttle = 0.0
        """Integral of the airspeed loop, in throttle."""

    @property
    def gains(self) -> dict[str, float]:
        """Gains in force, by name."""
        return msgspec.structs.asdict(self._gains)

    def set_gains(self, gains: dict[str, float]) -> None:
        """Changes gains by name, also in flight (S2.46); other gains stay.

        Raises: Denied when a name is unknown or a value out of range; no gain is changed then.
        """
        self._gains = changed(self._gains, gains)

    def update(self, wanted: Setpoint, state: FlightState, *, landed: bool, dt_s: float) -> ActuatorOutputs:
        """Computes the outputs of one control step of an armed aircraft."""
        if landed:
            self.reset()
            # full throttle releases the catapult; the controls stay neutral on its rail
            return _LAUNCH if wanted.vz_m_s > _LIFT_M_S else _GROUND
        limits = self._airframe.limits
        vx, vy, vz = state.velocity_m_s
        # there is no airspeed sensor; the lower bound keeps the divisions by the airspeed finite
        airspeed = max(math.hypot(vx, vy, vz), limits.airspeed_min_m_s / 2)
        ahead = math.hypot(wanted.vx_m_s, wanted.vy_m_s)
        speed = limits.airspeed_cruise_m_s if ahead < _STOP_M_S else ahead
        speed = min(max(speed, limits.airspeed_min_m_s), limits.airspeed_max_m_s)
        height_m = state.position_m[2]
        # the flare replaces the commanded sink rate by a slow one, with the throttle closed
        flares = wanted.vz_m_s < 0.0 and height_m < limits.flare_m
        climb = min(max(wanted.vz_m_s, -limits.sink_max_m_s), limits.climb_max_m_s)
        climb = max(climb, -limits.flare_sink_m_s) if flares else self._climb_to(climb, height_m, dt_s)
        bank = self._bank(wanted, state, airspeed)
        if flares or (wanted.vz_m_s > 0.0 and height_m < _CLIMB_OUT_M):
            bank = _bounded(bank, _LEVEL_RAD)
        throttle = 0.0 if flares else self._airspeed(speed, airspeed, climb, dt_s)
        alpha = self._attack(airspeed, bank)
        nose_up = self._nose_up(climb, airspeed, alpha, state, dt_s)
        servos = self._servos(bank, -nose_up, alpha, airspeed, state, dt_s)
        return ActuatorOutputs((throttle,), servos)

    def _climb_to(self, climb: float, height_m: float, dt_s: float) -> float:
        """Climb rate that also corrects the height, whose command is the integral of the climb set-points."""
        held = height_m if self._height_m is None else self._height_m + climb * dt_s
        self._height_m = min(max(held, height_m - _AHEAD_M), height_m + _AHEAD_M)
        limits = self._airframe.limits
        climb += self._gains.height_kp_1_s * (self._height_m - height_m)
        return min(max(climb, -limits.sink_max_m_s), limits.climb_max_m_s)

    def _bank(self, wanted: Setpoint, state: FlightState, airspeed: float) -> float:
        """Bank for the commanded course or for the circle, positive to the right."""
        limits = self._airframe.limits
        vx, vy, _ = state.velocity_m_s
        turn = wanted.wz_rad_s
        if math.hypot(wanted.vx_m_s, wanted.vy_m_s) < _STOP_M_S:
            if abs(turn) < 1e-3:
                turn = airspeed / limits.loiter_radius_m
        else:
            course = state.yaw_rad + math.atan2(wanted.vy_m_s, wanted.vx_m_s)
            error = math.remainder(course - math.atan2(vy, vx), math.tau)
            turn += self._gains.course_kp_1_s * error
        # a turn near the stall would need lift that the wing does not have
        load = max((airspeed / (_STALL_MARGIN * self._airframe.stall_m_s)) ** 2, _LOAD_MIN)
        bank_max = min(limits.bank_max_rad, math.acos(1 / load))
        return _bounded(-math.atan(airspeed * turn / GRAVITY_M_S2), bank_max)

    def _airspeed(self, speed: float, airspeed: float, climb: float, dt_s: float) -> float:
        """Throttle for an airspeed, with the power for the climb as feed-forward."""
        gains, limits = self._gains, self._airframe.limits
        error = speed - airspeed
        base = limits.throttle_cruise_ratio * speed / limits.airspeed_cruise_m_s
        base += limits.throttle_climb_s_m * climb
        throttle = base + gains.speed_kp_s_m * error + self._throttle
        if 0.0 < throttle < 1.0:  # anti-windup
            held = self._throttle + gains.speed_ki_1_m * error * dt_s
            self._throttle = _bounded(held, _THROTTLE_TRIM_MAX)
        return min(max(throttle, 0.0), 1.0)

    def _attack(self, airspeed: float, bank: float) -> float:
        """Angle of attack at which the wing carries the weight at this bank."""
        airframe = self._airframe
        pressure = AIR_DENSITY_KG_M3 / 2 * airspeed * airspeed * airframe.wing.area_m2
        lift = airframe.body.mass_kg * GRAVITY_M_S2 / pressure / math.cos(bank)
        alpha = (lift - airframe.wing.lift_0) / airframe.wing.lift_alpha
        return min(alpha, _ATTACK_MAX_RATIO * airframe.wing.stall_rad)

    def _nose_up(self, climb: float, airspeed: float, alpha: float, state: FlightState, dt_s: float) -> float:
        """Pitch for a climb rate, positive with the nose up, and limited below the minimum airspeed."""
        gains, limits = self._gains, self._airframe.limits
        error = climb - state.velocity_m_s[2]
        if airspeed >= limits.airspeed_min_m_s:
            held = self._climb + gains.climb_ki_1_m * error * dt_s
            # frozen below the minimum airspeed, where the limited pitch would wind it up
            self._climb = _bounded(held, _CLIMB_MAX_RAD)
        path = math.asin(min(max(climb / airspeed, -0.5), 0.5))
        pitch_max = limits.pitch_max_rad
        # below the minimum airspeed the nose goes down, to gain speed before height
        slow = limits.airspeed_min_m_s - airspeed
        if slow > 0.0:
            pitch_max = max(0.0, pitch_max - slow * _SLOW_RAD_S_M)
        return min(
            max(path + alpha + gains.climb_kp_s_m * error + self._climb, -limits.pitch_max_rad), pitch_max
        )

    def _servos(
        self,
        roll_rad: float,
        pitch_rad: float,
        alpha_rad: float,
        airspeed: float,
        state: FlightState,
        dt_s: float,
    ) -> tuple[float, float, float]:
        """Aileron, elevator and rudder for a roll, positive to the right, and a pitch, positive with nose
        down."""
        airframe, gains = self._airframe, self._gains
        p, q, r = state.rates_rad_s
        # the effect of control surfaces grows with the dynamic pressure
        effect = (airframe.limits.airspeed_cruise_m_s / airspeed) ** 2
        roll_error, error = roll_rad - state.roll_rad, pitch_rad - state.pitch_rad
        # rates of a level turn at this bank
        turn = -GRAVITY_M_S2 * math.tan(state.roll_rad) / airspeed
        q_turn, r_turn = turn * math.sin(state.roll_rad), turn * math.cos(state.roll_rad)
        if airspeed >= airframe.limits.airspeed_min_m_s:
            self._pitch = _bounded(self._pitch + gains.pitch_ki_1_s * error * dt_s, _TRIM_MAX)
            self._roll = _bounded(self._roll + gains.roll_ki_1_s * roll_error * dt_s, _TRIM_MAX)
        wing, surfaces = airframe.wing, airframe.surfaces
        trim = -(wing.moment_0 + wing.moment_alpha * alpha_rad) / wing.moment_elevator
        aileron = gains.roll_kp * roll_error - gains.roll_kd_s * p + self._roll
        elevator = gains.pitch_kp * error - gains.pitch_kd_s * (q - q_turn) + self._pitch
        rudder = -gains.yaw_kd_s * (r - r_turn)
        return (
            _bounded(aileron * effect, 1.0),
            _bounded(elevator * effect + trim / surfaces.elevator_max_rad, 1.0),
            _bounded(rudder * effect, 1.0),
        )

    @property
    def tilt_limit_rad(self) -> float:
        """Tilt above all commanded tilts, beyond which the aircraft counts as out of control."""
        return self._airframe.limits.bank_max_rad + _TILT_MARGIN_RAD

    def expect_gap(self, gap_s: float) -> None:
        """Does nothing, because an aircraft is stable without control."""

    def resume(self) -> None:
        """Continues after a gap; integrals stay, and the commanded height begins at the aircraft's height."""
        self._height_m = None

    def reset(self) -> None:
        """Clears all integrals when the aircraft is disarmed or on the ground."""
        self._roll = self._pitch = self._climb = self._throttle = 0.0
        self._height_m = None


def _bounded(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
