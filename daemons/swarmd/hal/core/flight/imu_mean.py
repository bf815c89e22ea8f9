"""Mean of inertial samples, for consumers that are slower than the flight controller."""

from swarmware.types.vehicle import Imu


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
