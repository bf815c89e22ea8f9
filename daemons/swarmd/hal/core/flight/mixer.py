"""Mixer, which turns thrust and moments into the motor outputs of a multirotor."""

import math
from collections.abc import Sequence
from typing import Final

from swarmware.geometry.attitude import Vector
from swarmware.model.airframe import MultirotorAirframe

IDLE: Final = 0.06
"""Output of the motors of an armed vehicle on the ground, at which the rotors turn without lifting off."""


class Mixer:
    """Least-squares allocation, which finds the smallest rotor thrusts that produce thrust and moments.

    When a rotor would exceed its range, the yaw moment is reduced first, then the common thrust, because a
    vehicle that keeps its roll and pitch keeps its lift.
    Source: Johansen, Fossen 2013, "Control allocation: a survey", Automatica 49.
    """

    __slots__ = ("_max_n", "_min_n", "_rows")

    def __init__(self, airframe: MultirotorAirframe) -> None:
        ratio = airframe.motor.torque_ratio_m
        effects = [(1.0, rotor.y_m, -rotor.x_m, rotor.torque_sign * ratio) for rotor in airframe.rotors]
        self._rows = _pseudo_inverse(effects)
        """Row per rotor: its thrust per unit of total thrust, and per unit of moment about the three axes."""
        self._max_n = airframe.motor.thrust_max_n
        self._min_n = self._max_n * IDLE**2

    def outputs(self, thrust_n: float, moment_n_m: Vector) -> tuple[tuple[float, ...], bool]:
        """Output of each motor, and True if the outputs produce the whole thrust and moments."""
        roll, pitch, yaw = moment_n_m
        tilts = [row[0] * thrust_n + row[1] * roll + row[2] * pitch for row in self._rows]
        turns = [row[3] * yaw for row in self._rows]
        low, high = self._min_n, self._max_n
        scale = 1.0
        for tilt, turn in zip(tilts, turns, strict=True):
            # the yaw moment is scaled down until every rotor is within its range
            if turn > 0.0 and tilt + turn > high:
                scale = min(scale, max(0.0, high - tilt) / turn)
            elif turn < 0.0 and tilt + turn < low:
                scale = min(scale, max(0.0, tilt - low) / -turn)
        thrusts = [tilt + turn * scale for tilt, turn in zip(tilts, turns, strict=True)]
        # a common shift keeps roll and pitch moments; raising a rotor from its minimum has priority
        shift = max(0.0, low - min(thrusts)) or min(0.0, high - max(thrusts))
        exact = scale == 1.0 and shift == 0.0
        # thrust grows with the square of a motor's output
        return tuple(math.sqrt(min(max(thrust + shift, low), high) / high) for thrust in thrusts), exact


def _pseudo_inverse(effects: Sequence[tuple[float, float, float, float]]) -> list[tuple[float, ...]]:
    """B⁺ = Bᵀ (B Bᵀ)⁻¹ of the matrix whose columns are the effects of the rotors."""
    square = [[sum(e[i] * e[k] for e in effects) for k in range(4)] for i in range(4)]
    return [tuple(_solved(square, effect)) for effect in effects]


def _solved(square: list[list[float]], right: Sequence[float]) -> list[float]:
    """Solution of a symmetric positive definite system by elimination."""
    a = [[*row, value] for row, value in zip(square, right, strict=True)]
    size = len(a)
    for i in range(size):
        a[i] = [value / a[i][i] for value in a[i]]
        for k in range(size):
            if k != i:
                factor = a[k][i]
                a[k] = [value - factor * pivot for value, pivot in zip(a[k], a[i], strict=True)]
    return [row[-1] for row in a]
