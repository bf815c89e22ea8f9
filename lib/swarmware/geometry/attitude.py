"""Attitudes as unit quaternions x y z w, from the body (FLU) to the map (ENU), and vectors turned by them."""

import math

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Matrix = tuple[float, float, float, float, float, float, float, float, float]
"""Rows of a rotation from the body to the map."""

LEVEL: Quaternion = (0.0, 0.0, 0.0, 1.0)


def from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """The attitude after a turn by yaw, then pitch, then roll; positive pitch lowers the nose (REP-103)."""
    cr, sr = math.cos(roll_rad / 2), math.sin(roll_rad / 2)
    cp, sp = math.cos(pitch_rad / 2), math.sin(pitch_rad / 2)
    cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def to_euler(q: Quaternion) -> Vector:
    """Roll, pitch and yaw."""
    x, y, z, w = q
    sine = 2 * (w * y - z * x)
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, sine))),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


def turned(q: Quaternion, rates_rad_s: Vector, dt_s: float) -> Quaternion:
    """The attitude after a turn at constant body rates."""
    p, s, r = rates_rad_s
    angle = math.sqrt(p * p + s * s + r * r) * dt_s
    # sin(a/2)/a is 1/2 where the angle vanishes
    scale = math.sin(angle / 2) / angle * dt_s if angle > 1e-9 else dt_s / 2
    a, b, c, d = p * scale, s * scale, r * scale, math.cos(angle / 2)
    x, y, z, w = q
    x, y, z, w = (
        w * a + x * d + y * c - z * b,
        w * b - x * c + y * d + z * a,
        w * c + x * b - y * a + z * d,
        w * d - x * a - y * b - z * c,
    )
    length = math.sqrt(x * x + y * y + z * z + w * w)
    return x / length, y / length, z / length, w / length


def matrix(q: Quaternion) -> Matrix:
    """The rotation from the body to the map."""
    x, y, z, w = q
    return (
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    )


def to_map(m: Matrix, v: Vector) -> Vector:
    """A vector of the body in map coordinates."""
    a, b, c = v
    return (
        m[0] * a + m[1] * b + m[2] * c,
        m[3] * a + m[4] * b + m[5] * c,
        m[6] * a + m[7] * b + m[8] * c,
    )


def to_body(m: Matrix, v: Vector) -> Vector:
    """A vector of the map in body coordinates."""
    a, b, c = v
    return (
        m[0] * a + m[3] * b + m[6] * c,
        m[1] * a + m[4] * b + m[7] * c,
        m[2] * a + m[5] * b + m[8] * c,
    )


def levelled(v: Vector, roll_rad: float, pitch_rad: float) -> Vector:
    """A vector of the body in the frame with the same heading whose axis up is vertical."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    a, b, c = v
    over = sr * b + cr * c
    return cp * a + sp * over, cr * b - sr * c, cp * over - sp * a
