"""A rigid body with six degrees of freedom, moved by forces and moments.

Interface for airframes: position, velocity and attitude are tuples in ENU and x y z w, the rates are in body
axes (FLU). `step` takes the sum of all forces except gravity, and of all moments, in body axes.
"""

import math

from swarmware.geometry.attitude import Matrix, Vector, from_euler, matrix, to_body, to_euler, to_map, turned
from swarmware.geometry.geodesy import GRAVITY_M_S2


class RigidBody:
    """Integrates the equations of Newton and Euler for a body whose axes are its principal axes of inertia.

    Integration is semi-implicit for rates and velocity, and exact for the rotation of one step.
    """

    __slots__ = (
        "_inertia",
        "_mass_kg",
        "_matrix",
        "attitude",
        "position_m",
        "rates_rad_s",
        "specific_force_m_s2",
        "velocity_m_s",
    )

    def __init__(self, mass_kg: float, inertia_kg_m2: Vector, position_m: Vector, yaw_rad: float) -> None:
        self._mass_kg = mass_kg
        self._inertia = inertia_kg_m2
        self.position_m = position_m
        """Position in the map."""
        self.velocity_m_s: Vector = (0.0, 0.0, 0.0)
        """Velocity in the map."""
        self.attitude = from_euler(0.0, 0.0, yaw_rad)
        """Attitude as the rotation from the body to the map."""
        self.rates_rad_s: Vector = (0.0, 0.0, 0.0)
        """Rates about the body axes."""
        self.specific_force_m_s2: Vector = (0.0, 0.0, GRAVITY_M_S2)
        """Specific force in body axes: all forces except gravity, divided by the mass."""
        self._matrix: Matrix = matrix(self.attitude)

    @property
    def mass_kg(self) -> float:
        """Mass of the body."""
        return self._mass_kg

    @property
    def up(self) -> float:
        """Cosine of the angle between the upward body axis and the vertical."""
        return self._matrix[8]

    def to_map(self, vector: Vector) -> Vector:
        """Rotates a vector from body axes to map coordinates."""
        return to_map(self._matrix, vector)

    def to_body(self, vector: Vector) -> Vector:
        """Rotates a vector from map coordinates to body axes."""
        return to_body(self._matrix, vector)

    def angles_rad(self) -> Vector:
        """Attitude as roll, pitch and yaw."""
        return to_euler(self.attitude)

    def step(self, force_n: Vector, moment_n_m: Vector, dt_s: float) -> None:
        """Moves the body for a duration at constant force and moment."""
        ix, iy, iz = self._inertia
        p, q, r = self.rates_rad_s
        p, q, r = self.rates_rad_s = (
            p + (moment_n_m[0] + (iy - iz) * q * r) / ix * dt_s,
            q + (moment_n_m[1] + (iz - ix) * r * p) / iy * dt_s,
            r + (moment_n_m[2] + (ix - iy) * p * q) / iz * dt_s,
        )
        mass = self._mass_kg
        # before gravity is added: an accelerometer does not measure gravity
        self.specific_force_m_s2 = force_n[0] / mass, force_n[1] / mass, force_n[2] / mass
        ax, ay, az = to_map(self._matrix, self.specific_force_m_s2)
        vx, vy, vz = before = self.velocity_m_s
        vx, vy, vz = self.velocity_m_s = vx + ax * dt_s, vy + ay * dt_s, vz + (az - GRAVITY_M_S2) * dt_s
        x, y, z = self.position_m
        half = dt_s / 2
        self.position_m = (
            x + (vx + before[0]) * half,
            y + (vy + before[1]) * half,
            z + (vz + before[2]) * half,
        )
        self.attitude = turned(self.attitude, (p, q, r), dt_s)
        self._matrix = matrix(self.attitude)

    def stand(self, pitch_rad: float) -> None:
        """Puts the body on the ground at its place, with the given pitch and unchanged heading and speed."""
        x, y, _ = self.position_m
        vx, vy, _ = self.velocity_m_s
        self.position_m, self.velocity_m_s = (x, y, 0.0), (vx, vy, 0.0)
        self.rates_rad_s = (0.0, 0.0, 0.0)
        self.attitude = from_euler(0.0, pitch_rad, self.angles_rad()[2])
        self._matrix = matrix(self.attitude)
        self.specific_force_m_s2 = self.to_body((0.0, 0.0, GRAVITY_M_S2))

    def slide(self, speed_m_s: float, dt_s: float) -> None:
        """Moves a body on the ground, and changes its speed but not its direction."""
        x, y, z = self.position_m
        vx, vy, _ = self.velocity_m_s
        # friction acts against the motion
        ratio = speed_m_s / math.hypot(vx, vy)
        self.position_m = x + vx * dt_s, y + vy * dt_s, z
        self.velocity_m_s = vx * ratio, vy * ratio, 0.0

    def rest(self, position_m: Vector) -> None:
        """Puts the body at rest at a position, with the same attitude."""
        self.position_m = position_m
        self.velocity_m_s = self.rates_rad_s = (0.0, 0.0, 0.0)
        self.specific_force_m_s2 = self.to_body((0.0, 0.0, GRAVITY_M_S2))
