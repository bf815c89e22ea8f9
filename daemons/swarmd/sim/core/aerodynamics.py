"""Aerodynamics of a fixed-wing aircraft: forces and moments from angle of attack, side slip, deflections."""

import math
from typing import Final

import msgspec

from swarmware.model.fixed_wing_airframe import (
    AIR_DENSITY_KG_M3,
    LateralConfig,
    PropellerConfig,
    WingConfig,
)

Vector = tuple[float, float, float]

_STILL_M_S: Final = 0.5
"""Airspeed below which forces are neglected, because the angle of attack is undefined at rest."""


class Deflections(msgspec.Struct, frozen=True, gc=False):
    """Deflections of the control surfaces in rad, with the signs of the source.

    Positive: right wing down, nose down, nose left.
    """

    aileron: float
    elevator: float
    rudder: float


def lift_coefficient(wing: WingConfig, alpha_rad: float) -> float:
    """Lift coefficient by angle of attack, linear below the stall and of a flat plate beyond.

    Source: Beard and McLain 2012, equations 4.9 and 4.10.
    """
    linear = wing.lift_0 + wing.lift_alpha * alpha_rad
    sin = math.sin(alpha_rad)
    plate = 2 * math.copysign(sin * sin, alpha_rad) * math.cos(alpha_rad)
    separated = _separated(wing, alpha_rad)
    return (1 - separated) * linear + separated * plate


def drag_coefficient(wing: WingConfig, alpha_rad: float) -> float:
    """Drag coefficient by angle of attack, parasitic and induced below the stall, of a flat plate beyond."""
    linear = wing.lift_0 + wing.lift_alpha * alpha_rad
    ratio = wing.span_m**2 / wing.area_m2
    attached = wing.drag_0 + linear * linear / (math.pi * wing.oswald * ratio)
    sin = math.sin(alpha_rad)
    separated = _separated(wing, alpha_rad)
    return (1 - separated) * attached + separated * (wing.drag_0 + 2 * abs(sin) * sin * sin)


def _separated(wing: WingConfig, alpha_rad: float) -> float:
    """Ratio of separated flow (Beard and McLain 2012, equation 4.10)."""
    sharp, stall = wing.stall_sharpness_1_rad, wing.stall_rad
    # the exponents are bounded, because a tumbling aircraft can have any angle
    up = math.exp(min(-sharp * (alpha_rad - stall), 300.0))
    down = math.exp(min(sharp * (alpha_rad + stall), 300.0))
    return (1 + up + down) / ((1 + up) * (1 + down))


def air_loads(
    wing: WingConfig, lateral: LateralConfig, air_m_s: Vector, rates_rad_s: Vector, surfaces: Deflections
) -> tuple[Vector, Vector]:
    """Aerodynamic force in N and moment in N m, in body axes forward, right, down.

    `air_m_s`: velocity through the air, in the same axes.
    """
    u, v, w = air_m_s
    speed = math.hypot(u, v, w)
    if speed < _STILL_M_S:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    alpha = math.atan2(w, u)
    beta = math.asin(min(max(v / speed, -1.0), 1.0))
    p, q, r = rates_rad_s
    # rates enter the coefficients as dimensionless ratios
    by_span, by_chord = wing.span_m / (2 * speed), wing.chord_m / (2 * speed)
    lift = lift_coefficient(wing, alpha) + wing.lift_q * by_chord * q + wing.lift_elevator * surfaces.elevator
    drag = drag_coefficient(wing, alpha) + wing.drag_elevator * abs(surfaces.elevator)
    side = (
        lateral.side_beta * beta
        + (lateral.side_p * p + lateral.side_r * r) * by_span
        + lateral.side_aileron * surfaces.aileron
        + lateral.side_rudder * surfaces.rudder
    )
    roll = (
        lateral.roll_beta * beta
        + (lateral.roll_p * p + lateral.roll_r * r) * by_span
        + lateral.roll_aileron * surfaces.aileron
        + lateral.roll_rudder * surfaces.rudder
    )
    # the sine lets the moment saturate, because beyond the stall the tail still turns the nose into the flow
    pitch = (
        wing.moment_0
        + wing.moment_alpha * math.sin(alpha)
        + wing.moment_q * by_chord * q
        + wing.moment_elevator * surfaces.elevator
    )
    yaw = (
        lateral.yaw_beta * beta
        + (lateral.yaw_p * p + lateral.yaw_r * r) * by_span
        + lateral.yaw_aileron * surfaces.aileron
        + lateral.yaw_rudder * surfaces.rudder
    )
    pressure = AIR_DENSITY_KG_M3 / 2 * speed * speed * wing.area_m2
    cos, sin = math.cos(alpha), math.sin(alpha)
    force = (
        pressure * (lift * sin - drag * cos),
        pressure * side,
        pressure * (-drag * sin - lift * cos),
    )
    moment = (
        pressure * wing.span_m * roll,
        pressure * wing.chord_m * pitch,
        pressure * wing.span_m * yaw,
    )
    return force, moment


def propeller(config: PropellerConfig, throttle_ratio: float, air_m_s: float) -> tuple[float, float, float]:
    """Thrust in N, torque in N m and electric power in W of a propeller, at an airspeed along its axis.

    The speed of the propeller follows from the balance of its torque with the motor's torque.
    Source: McLain and Beard, supplement of "Small Unmanned Aircraft", equations 4.17 to 4.22.
    """
    volts = throttle_ratio * config.voltage_max_v
    constant, ohm = config.motor_constant_v_s, config.resistance_ohm
    # the voltage does not overcome the friction of the motor
    if volts <= ohm * config.idle_current_a:
        return 0.0, 0.0, 0.0
    d, air = config.diameter_m, max(air_m_s, 0.0)
    q0, q1, q2 = config.torque
    # propeller torque minus motor torque is a ω² + b ω + c
    a = AIR_DENSITY_KG_M3 * d**5 / math.tau**2 * q0
    b = AIR_DENSITY_KG_M3 * d**4 / math.tau * q1 * air + constant * constant / ohm
    c = AIR_DENSITY_KG_M3 * d**3 * q2 * air * air - constant / ohm * volts + constant * config.idle_current_a
    omega = (-b + math.sqrt(max(b * b - 4 * a * c, 0.0))) / (2 * a)
    turns = omega / math.tau
    if turns <= 0.0:
        return 0.0, 0.0, 0.0
    advance = air / (turns * d)
    t0, t1, t2 = config.thrust
    dynamic = AIR_DENSITY_KG_M3 * turns * turns * d**4
    thrust = dynamic * (t0 + t1 * advance + t2 * advance * advance)
    torque = dynamic * d * (q0 + q1 * advance + q2 * advance * advance)
    current = max(0.0, (volts - constant * omega) / ohm)
    return thrust, torque, volts * current
