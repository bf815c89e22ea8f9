"""Platforms that were reached and are not any more."""

from typing import Final

LOST_NS: Final = 3_000_000_000
"""A link is down after one second; routes by others take a little longer, flaps are no loss."""


class Platforms:
    """Who has been reached since the start, or was missed by a former monitor."""

    def __init__(self) -> None:
        self._seen_ns: dict[str, int] = {}
        self._lost: set[str] = set()

    def __contains__(self, platform: str) -> bool:
        return platform in self._seen_ns or platform in self._lost

    def lose(self, platform: str) -> None:
        """A former monitor missed it."""
        self._lost.add(platform)

    def forget(self, platform: str) -> None:
        """It is not missed any more, until it has been reached again."""
        self._lost.discard(platform)
        self._seen_ns.pop(platform, None)

    def on_present(self, present: set[str], now_ns: int) -> list[tuple[str, float | None]]:
        """Changes: platforms that are lost, with the seconds since they were reached, or (None) back."""
        for platform in present:
            self._seen_ns[platform] = now_ns
        back = self._lost & present
        gone = {
            platform
            for platform, seen_ns in self._seen_ns.items()
            if platform not in self._lost and now_ns - seen_ns >= LOST_NS
        }
        self._lost = (self._lost - back) | gone
        changes: list[tuple[str, float | None]] = [(platform, None) for platform in sorted(back)]
        return changes + [(platform, (now_ns - self._seen_ns[platform]) / 1e9) for platform in sorted(gone)]
