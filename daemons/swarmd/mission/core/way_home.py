"""Charge for the way home: distance and height over the speeds of a return, times the measured discharge."""

import math
from collections import deque
from typing import Final

from swarmware.mission.catalogue import Land, Return, Takeoff
from swarmware.types.reaction import WayHome
from swarmware.types.vehicle import Pose

RETURN_HEIGHT_M: Final = 2.0
"""A lower vehicle climbs to this height before it returns: obstacles on the direct way are not known."""
WINDOW_NS: Final = 120_000_000_000
"""Time over which the discharge is averaged."""
SPAN_MIN_NS: Final = 10_000_000_000
"""Minimum time for which the discharge must have been observed."""
CHARGED_RATIO: Final = 0.01
"""Rise of the charge that no flight explains: the battery was exchanged or charged."""
MARGIN: Final = 1.3
"""Factor on the time of the return, for wind and obstacles on the way."""
FINAL_M: Final = 1.5
"""Height below which a landing vehicle descends at touch-down speed."""
TOUCH_DOWN_M_S: Final = 0.5
"""Descent rate below that height, as set for the navigator by default."""
LEVELLING_S: Final = 6.0
"""Time to accelerate, to brake, to settle above the place, and to confirm the touch-down."""


class WayHomeEstimate:
    """Measures the discharge, and estimates the charge that a return needs."""

    def __init__(self, reserve_ratio: float) -> None:
        self._reserve_ratio = reserve_ratio
        self._samples: deque[tuple[int, float]] = deque()

    def on_charge(self, ratio: float, now_ns: int) -> None:
        """Takes the remaining charge of a vehicle that is armed."""
        if self._samples and ratio > self._samples[-1][1] + CHARGED_RATIO:
            self._samples.clear()
        self._samples.append((now_ns, ratio))
        while now_ns - self._samples[0][0] > WINDOW_NS:
            self._samples.popleft()

    def on_disarmed(self) -> None:
        """Forgets the discharge: a vehicle at rest draws little."""
        self._samples.clear()

    @property
    def discharge_1_s(self) -> float | None:
        """Part of the charge that is drawn in a second, or None while unknown."""
        if not self._samples:
            return None
        (begin_ns, before), (end_ns, after) = self._samples[0], self._samples[-1]
        if end_ns - begin_ns < SPAN_MIN_NS or after >= before:
            return None
        return (before - after) / ((end_ns - begin_ns) / 1e9)

    def estimate(self, pose: Pose, home: Pose, *, flies: bool) -> WayHome | None:
        """Charge for the way from here to home, or None without a measured charge."""
        if not self._samples:
            return None
        remaining = self._samples[-1][1]
        distance_m = math.hypot(home.x_m - pose.x_m, home.y_m - pose.y_m)
        duration_s = distance_m / Return().speed_m_s
        if flies:
            # the return climbs to its height first, then descends from there
            height_m = max(pose.z_m - home.z_m, RETURN_HEIGHT_M)
            climb_m = max(RETURN_HEIGHT_M - (pose.z_m - home.z_m), 0.0)
            duration_s += climb_m / Takeoff(altitude_m=RETURN_HEIGHT_M).speed_m_s
            duration_s += (height_m - FINAL_M) / Land().speed_m_s + FINAL_M / TOUCH_DOWN_M_S
        duration_s = duration_s * MARGIN + LEVELLING_S
        rate = self.discharge_1_s
        needed = None if rate is None else round(rate * duration_s + self._reserve_ratio, 4)
        return WayHome(round(distance_m, 1), round(duration_s, 1), remaining, needed)
