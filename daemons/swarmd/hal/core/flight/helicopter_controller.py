"""Controller of a helicopter: the cascade of hovering vehicles, with cyclic, collective and pedal outputs."""

from typing import Final

from swarmd.hal.core.flight.hover_controller import Demand, HoverController
from swarmware.geometry.attitude import Vector
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.model.helicopter_airframe import HelicopterAirframe
from swarmware.types.chassis import ActuatorOutputs

_GROUND: Final = ActuatorOutputs((1.0,), (0.0, 0.0, -0.8, 0.0))
"""Outputs on the ground, where the rotor turns at full speed with little pitch."""
_LIFT_MIN, _LIFT_MAX = 0.4, 1.7
"""Limits of the ratio of commanded thrust to weight."""


class HelicopterController(HoverController):
    """Control law of a helicopter, whose rotor disc tilts."""

    def __init__(self, airframe: HelicopterAirframe) -> None:
        # with an inertia of 1 the moments of the rate loop are angular accelerations
        super().__init__(airframe.gains, airframe.limits, (1.0, 1.0, 1.0), _GROUND)
        self._airframe = airframe

    def _actuated(self, demand: Demand) -> tuple[ActuatorOutputs, float, bool]:
        lift = demand.lift_m_s2 / demand.upright
        lift = min(max(lift, _LIFT_MIN * GRAVITY_M_S2), _LIFT_MAX * GRAVITY_M_S2)
        collective = self._airframe.collective(self._airframe.body.mass_kg * lift)
        lateral, longitudinal = self._cyclic(demand.turn, demand.rates_rad_s)
        pedal = self._pedal(demand.turn[2], demand.rates_rad_s[2], collective)
        servos = (lateral, longitudinal, collective, pedal)
        a, b, c, d = (min(max(servo, -1.0), 1.0) for servo in servos)
        whole = all(abs(servo) < 1.0 for servo in servos)
        return ActuatorOutputs((1.0,), (a, b, c, d)), lift * demand.upright / GRAVITY_M_S2, whole

    def _cyclic(self, turning: Vector, rates: Vector) -> tuple[float, float]:
        """Lateral and longitudinal control for a turn of the body, in the steady state of the rotor disc.

        The disc lags behind a turning body by the time constant of flapping, so the control adds this tilt.
        """
        of = self._airframe.derivatives
        b, a = turning[0] / of.l_b, -turning[1] / of.m_a
        across = b - of.b_a * a + of.tau_f_s * rates[0]
        along = a - of.a_b * b - of.tau_f_s * rates[1]
        # determinant of the coupling of both controls, which is inverted here
        full = of.a_lon * of.b_lat - of.a_lat * of.b_lon
        return (
            (of.a_lon * across - of.b_lon * along) / full,
            (of.b_lat * along - of.a_lat * across) / full,
        )

    def _pedal(self, turning_rad_s2: float, rate_rad_s: float, collective: float) -> float:
        """Pedal, positive to the left, for a yaw acceleration; compensates damping, gyro and main-rotor
        torque."""
        of = self._airframe.derivatives
        damped = -of.n_r / of.n_ped - of.k_r / of.k_rfb
        return turning_rad_s2 / of.n_ped + damped * rate_rad_s + of.n_col * collective / of.n_ped
