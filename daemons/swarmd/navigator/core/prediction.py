"""Prediction of the pose of a vehicle to an instant after its estimate."""

from typing import Final

from swarmware.types.vehicle import Pose

_AHEAD_MAX_S: Final = 0.5
"""Maximum prediction of the own pose."""


def predicted(pose: Pose, ahead_s: float) -> Pose:
    """Predicts the pose after this time at constant velocity and rate of turn."""
    if ahead_s == 0.0:
        return pose
    return Pose.planar(
        pose.x_m + pose.vx_m_s * ahead_s,
        pose.y_m + pose.vy_m_s * ahead_s,
        pose.z_m + pose.vz_m_s * ahead_s,
        pose.yaw_rad + pose.wz_rad_s * ahead_s,
        (pose.vx_m_s, pose.vy_m_s, pose.vz_m_s),
        pose.wz_rad_s,
    )


class ReceivedPose:
    """The own pose that another computer has estimated, predicted to the instant of use."""

    def __init__(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self._pose: Pose | None = None
        self._stamp_ns = 0

    def on_pose(self, pose: Pose, stamp_ns: int) -> None:
        """Takes an estimate, stamped in the own clock; an outdated estimate changes nothing."""
        if self._pose is None or stamp_ns > self._stamp_ns:
            self._pose, self._stamp_ns = pose, stamp_ns

    def at(self, now_ns: int) -> Pose | None:
        """The present pose, or None if the newest estimate is too old to steer by it."""
        if self._pose is None:
            return None
        age_s = (now_ns - self._stamp_ns) / 1e9
        # without a pose the guidance stops the vehicle
        if age_s > self._timeout_s:
            return None
        return predicted(self._pose, min(max(age_s, 0.0), _AHEAD_MAX_S))
