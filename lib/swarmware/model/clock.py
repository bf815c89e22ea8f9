"""The node's hardware clock: monotonic and never set; in the lab with a configured offset and drift."""

import time


class Clock:
    """Nanoseconds of one hardware unit (S1.64: clocks are read, never adjusted).

    The lab gives every node another offset and drift, so that the true error of time
    synchronisation is known: true time is the machine's CLOCK_MONOTONIC.
    """

    __slots__ = ("_drift_ppb", "_offset_ns", "boot_id")

    def __init__(self, offset_s: float = 0.0, drift_ppm: float = 0.0, boot_id: int = 0) -> None:
        self._offset_ns = round(offset_s * 1e9)
        self._drift_ppb = round(drift_ppm * 1000)
        self.boot_id = boot_id
        """Changes with each start of the node; later starts have larger ones."""

    def now_ns(self) -> int:
        """The present instant on the hardware clock."""
        mono_ns = time.monotonic_ns()  # `from_mono_ns` without the call: it is read several times a frame
        return mono_ns + mono_ns * self._drift_ppb // 1_000_000_000 + self._offset_ns

    def from_mono_ns(self, mono_ns: int) -> int:
        """Reading of this clock at an instant of CLOCK_MONOTONIC."""
        return mono_ns + mono_ns * self._drift_ppb // 1_000_000_000 + self._offset_ns

    def to_mono_ns(self, stamp_ns: int) -> int:
        """The instant of CLOCK_MONOTONIC at which this clock showed the stamp (±1 ns)."""
        return (stamp_ns - self._offset_ns) * 1_000_000_000 // (1_000_000_000 + self._drift_ppb)


def utc_ns() -> int:
    """Wall-clock time, only for display, exports and boot ids."""
    return time.time_ns()
