"""The link to the ground stations: lost when none has been in reach for a time."""


class LinkLoss:
    """Reports each loss of the link once; a platform that never had a link has none to lose."""

    def __init__(self) -> None:
        self._station_ns: int | None = None
        """When a ground station was in reach last; None: never, or its loss was reported."""

    def on_station(self, now_ns: int) -> None:
        """A ground station is in reach."""
        self._station_ns = now_ns

    def lost_s(self, timeout_s: float, now_ns: int) -> float | None:
        """Seconds without a ground station, once, when they exceed the time-out; otherwise None."""
        if self._station_ns is None:
            return None
        silent_s = (now_ns - self._station_ns) / 1e9
        if silent_s <= timeout_s:
            return None
        self._station_ns = None
        return silent_s
