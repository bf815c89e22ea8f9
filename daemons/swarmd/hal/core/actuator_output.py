"""The decisions of one output, a servo or a motor: a fresh set-point, or the safe state."""

import math

from swarmware.types.scalar import Float


class ActuatorOutput:
    """Applies the newest set-point of an output while it is fresh and, if required, the vehicle is armed.

    `watchdog_s`: age of the set-point above which the output goes to its safe state.
    """

    def __init__(self, path: str, watchdog_s: float, *, needs_arming: bool) -> None:
        self._path = path
        self._watchdog_ns = round(watchdog_s * 1e9)
        self._needs_arming = needs_arming
        self._value = 0.0
        self._stamp_ns: int | None = None

    def on_value(self, value: Float, stamp_ns: int) -> None:
        """Takes a set-point with its instant; infinite values and NaN are ignored."""
        if math.isfinite(value.value):
            self._value, self._stamp_ns = min(max(value.value, -1.0), 1.0), stamp_ns

    def value(self, now_ns: int, *, armed: bool) -> float | None:
        """The set-point from -1 to 1, or None for the safe state."""
        if self._stamp_ns is None or self._is_old(now_ns) or (self._needs_arming and not armed):
            return None
        return self._value

    def failsafe(self, now_ns: int, *, armed: bool) -> str:
        """Reason of a fail-safe after set-points have stopped, or "" without a fail-safe."""
        if self._stamp_ns is None or not self._is_old(now_ns) or (self._needs_arming and not armed):
            return ""
        return f"no set-point in {self._path} for more than {self._watchdog_ns / 1e9:g} s"

    def _is_old(self, now_ns: int) -> bool:
        return self._stamp_ns is not None and now_ns - self._stamp_ns > self._watchdog_ns
