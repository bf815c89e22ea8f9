"""Main rotor of a helicopter, with thrust and power by blade-element and momentum theory."""

import math
from typing import Final

from swarmware.model.helicopter_airframe import AIR_DENSITY_KG_M3, MainRotorConfig

_ROUNDS: Final = 4
"""Rounds of the inflow iteration, each of which halves the error from the previous sample's inflow."""
_CLOSE_RATIO: Final = 0.5
"""Minimum ratio of height to radius in the formula of the ground effect, which is singular at 0.25."""


class MainRotor:
    """Thrust of a rotor with uniform inflow.

    Source: Leishman 2006, "Principles of Helicopter Aerodynamics", chapters 2 and 3; ground effect by
    Cheeseman and Bennett 1955.
    """

    __slots__ = ("_area_m2", "_config", "inflow_m_s", "power_w", "thrust_n")

    def __init__(self, config: MainRotorConfig) -> None:
        self._config = config
        self._area_m2 = math.pi * config.radius_m**2
        self.inflow_m_s = 0.0
        """Induced velocity through the disc, downwards."""
        self.thrust_n = 0.0
        self.power_w = 0.0
        """Shaft power, the sum of induced, climb and profile power."""

    def step(
        self, collective: float, along_m_s: float, climb_m_s: float, height_m: float, speed_ratio: float
    ) -> float:
        """Thrust in N for a collective control from -1 to 1.

        `along_m_s` and `climb_m_s`: velocity of the disc through the air, in its plane and upwards;
        `height_m`: height of the vehicle above the ground; `speed_ratio`: ratio of the rotor's to the
        governor's speed.
        """
        config, tip = self._config, self._config.tip_speed_m_s * speed_ratio
        if tip < 1.0:  # a stopped rotor has no lift
            self.inflow_m_s = self.thrust_n = self.power_w = 0.0
            return 0.0
        pitch = config.collective_mid_rad + collective * config.collective_span_rad
        advance2 = (along_m_s / tip) ** 2
        pressure = AIR_DENSITY_KG_M3 * self._area_m2 * tip * tip
        slope = config.lift_slope_1_rad * config.solidity / 2
        blades, limit = pitch / 3 * (1 + 1.5 * advance2), config.thrust_coefficient_max
        flow = self.inflow_m_s
        coefficient = 0.0
        for _ in range(_ROUNDS):
            coefficient = slope * (blades - (flow + climb_m_s) / tip / 2)
            # stall of the blades
            coefficient = min(max(coefficient, -limit), limit)
            # 0.1 m/s avoids the division by zero of a disc without flow
            speed = math.hypot(along_m_s, climb_m_s + flow, 0.1)
            flow = (flow + coefficient * tip * tip / (2 * speed)) / 2
        self.inflow_m_s = flow
        thrust = coefficient * pressure
        profile = config.solidity * config.drag_coefficient / 8 * (1 + 4.65 * advance2) * pressure * tip
        self.power_w = profile + max(0.0, thrust * (flow + climb_m_s))
        self.thrust_n = thrust * self._ground_effect(height_m)
        return self.thrust_n

    def _ground_effect(self, height_m: float) -> float:
        """Factor by which thrust grows near the ground at equal power."""
        above = max((height_m + self._config.hub_height_m) / self._config.radius_m, _CLOSE_RATIO)
        return 1 / (1 - 1 / (16 * above * above))
