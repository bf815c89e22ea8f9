"""Linear hover model of a helicopter: flapping, and the accelerations by flapping and air flow."""

from swarmware.model.helicopter_airframe import HoverDerivatives

Vector = tuple[float, float, float]


class HoverDynamics:
    """States of the rotors: flapping of the main rotor, and the gyro of the tail rotor.

    The linear hover model has these states and the six degrees of freedom of the rigid body. All vectors are
    in body axes forward, right, down.
    """

    __slots__ = ("_of", "gyro", "lateral_rad", "longitudinal_rad")

    def __init__(self, derivatives: HoverDerivatives) -> None:
        self._of = derivatives
        self.longitudinal_rad = 0.0
        """Backward tilt of the rotor disc."""
        self.lateral_rad = 0.0
        """Tilt of the rotor disc to the right."""
        self.gyro = 0.0
        """Pedal that the gyro of the tail rotor subtracts."""

    def flap(self, lateral: float, longitudinal: float, rates_rad_s: Vector, dt_s: float) -> None:
        """Advances flapping and gyro by a sample, from the cyclic controls and the rates of the body."""
        of = self._of
        a, b = self.longitudinal_rad, self.lateral_rad
        p, q, r = rates_rad_s
        a_rate = (
            -a / of.tau_f_s - q + (of.a_b * b + of.a_lat * lateral + of.a_lon * longitudinal) / of.tau_f_s
        )
        b_rate = (
            -b / of.tau_f_s - p + (of.b_a * a + of.b_lat * lateral + of.b_lon * longitudinal) / of.tau_f_s
        )
        self.longitudinal_rad = a + a_rate * dt_s
        self.lateral_rad = b + b_rate * dt_s
        # the rate gyro of the tail rotor damps yaw, as in the identified model
        self.gyro += (of.k_r * r + of.k_rfb * self.gyro) * dt_s

    def angular(self, air_m_s: Vector, rates_rad_s: Vector, collective: float, pedal: float) -> Vector:
        """Angular acceleration in rad/s²; `collective` is the difference to the collective in hover."""
        of = self._of
        u, v, w = air_m_s
        p, _, r = rates_rad_s
        return (
            of.l_u * u + of.l_v * v + of.l_b * self.lateral_rad,
            of.m_u * u + of.m_v * v + of.m_a * self.longitudinal_rad,
            of.n_p * p
            + of.n_v * v
            + of.n_w * w
            + of.n_r * r
            + of.n_col * collective
            + of.n_ped * (pedal - self.gyro),
        )

    def stop(self) -> None:
        """Levels the disc of a stopped rotor."""
        self.longitudinal_rad = self.lateral_rad = self.gyro = 0.0
