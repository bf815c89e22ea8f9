"""Which other platforms are known: present, lost, or only on the roster."""

from typing import Final

import msgspec

from swarmd.mission.core.admission import drained_text
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import LeftOut, MissionState

FIRST_STATE_NS: Final = 3_000_000_000
"""Time from the first route to a platform in which its first state is expected: its tree is synchronised
first."""


class _ReceivedState(msgspec.Struct):
    state: MissionState
    at_ns: int


class Census:
    """Collects the states of other platforms; lists who can take part in a mission, and who cannot."""

    def __init__(self, me: str, lost_after_ns: int) -> None:
        self._me = me
        self._lost_after_ns = lost_after_ns
        self.roster: frozenset[str] = frozenset()
        """All platforms with a key, also before the first contact, or empty without keys."""
        self._received: dict[str, _ReceivedState] = {}
        self._reached: dict[str, int] = {}
        self._first_reached: dict[str, int] = {}

    def on_state(self, platform: str, state: MissionState, at_ns: int) -> None:
        """A platform published this mission state at that instant."""
        self._received[platform] = _ReceivedState(state, at_ns)

    def on_reachable(self, platform: str, now_ns: int) -> None:
        """A platform has a route now."""
        self._reached[platform] = now_ns
        self._first_reached.setdefault(platform, now_ns)

    @property
    def has_states(self) -> bool:
        """Whether a state of another platform was received."""
        return bool(self._received)

    def first_state_until_ns(self, now_ns: int) -> int:
        """Until when first states of platforms in reach are expected, or 0 if no platform is awaited."""
        oldest_ns = now_ns - self._lost_after_ns
        return max(
            (
                first_ns + FIRST_STATE_NS
                for name, first_ns in self._first_reached.items()
                if name != self._me and name not in self._received and self._reached[name] >= oldest_ns
            ),
            default=0,
        )

    def present(self, now_ns: int) -> dict[str, MissionState]:
        """Platforms whose mission state was received within the time-out."""
        oldest_ns = now_ns - self._lost_after_ns
        return {
            name: received.state
            for name, received in self._received.items()
            # a platform with a route is present even while its mission state is lost
            if max(received.at_ns, self._reached.get(name, received.at_ns)) >= oldest_ns
        }

    def is_station(self, platform: str) -> bool:
        """Whether a platform is known to be a ground station."""
        received = self._received.get(platform)
        return received is not None and received.state.kind == PlatformKind.GCS

    def in_run(self, epoch: int) -> list[str]:
        """Platforms whose newest state is of this run."""
        return [name for name, received in self._received.items() if received.state.epoch == epoch]

    def absent(self, now_ns: int) -> list[LeftOut]:
        """Known platforms that cannot take part now, with the reason: lost, or drained by an operator."""
        present = self.present(now_ns)
        known = {*self._received, *self._reached, *self.roster} - {*present, self._me}
        found = {name: self._why(name, now_ns) for name in known}
        found |= {name: drained_text(state.drained_by) for name, state in present.items() if state.drained_by}
        return [LeftOut(name, found[name]) for name in sorted(found)]

    def _why(self, name: str, now_ns: int) -> str:
        received = self._received.get(name)
        reached_ns = self._reached.get(name)
        if received is not None:
            silent_s = (now_ns - max(received.at_ns, reached_ns or received.at_ns)) / 1e9
            return f"lost: no beacon for {silent_s:.0f} s"
        if reached_ns is not None and now_ns - reached_ns <= self._lost_after_ns:
            return "no state of its mission daemon was received"
        return (
            "out of reach"
            if reached_ns is not None
            else "on the roster, nothing received since this node started"
        )
