"""Presence of other platforms, which are reachable or lost."""

from typing import Final

LOST_NS: Final = 3_000_000_000
"""Time without a route that is a loss; a link is down after 1 s, an indirect route a little later."""


class PlatformPresence:
    """Detects the loss of platforms that were reachable before, or lost according to the journal."""

    def __init__(self) -> None:
        self._reached_ns: dict[str, int] = {}
        self._lost: set[str] = set()

    def __contains__(self, platform: str) -> bool:
        return platform in self._reached_ns or platform in self._lost

    def restore_lost(self, platform: str) -> None:
        """Restores the loss of a platform that the previous monitor announced."""
        self._lost.add(platform)

    def forget(self, platform: str) -> None:
        """Forgets a platform until it is reachable again."""
        self._lost.discard(platform)
        self._reached_ns.pop(platform, None)

    def on_reachable(self, reachable: set[str], now_ns: int) -> list[tuple[str, float | None]]:
        """Returns changed platforms, with the seconds since they were reachable, or None if reachable
        again."""
        for platform in reachable:
            self._reached_ns[platform] = now_ns
        # only a reported loss has a return to report
        back = self._lost & reachable
        gone = {
            platform
            for platform, seen_ns in self._reached_ns.items()
            if platform not in self._lost and now_ns - seen_ns >= LOST_NS
        }
        self._lost = (self._lost - back) | gone
        changes: list[tuple[str, float | None]] = [(platform, None) for platform in sorted(back)]
        return changes + [
            (platform, (now_ns - self._reached_ns[platform]) / 1e9) for platform in sorted(gone)
        ]
