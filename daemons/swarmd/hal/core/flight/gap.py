"""Interpolation of inertial samples in a gap, in which the actuators held their outputs."""

from swarmware.types.vehicle import Imu


def between(before: Imu, after: Imu, at_s: float, gap_s: float, held_s: float) -> Imu:
    """Interpolates the sample at an instant of a gap, without a heading.

    Held outputs mean constant moments and thrust, so the rates change linearly while they are held. After the
    motors have stopped the rates stay, and the specific force is the one of free fall.
    Units: `at_s` and `gap_s` since the previous sample; `held_s`: time for which outputs are held.
    """
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
