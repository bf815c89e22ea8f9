"""Outages of links: when each began, how long it took to detect it, to recover, and to drain what waited."""

from collections import deque
from collections.abc import Iterable
from typing import Final

import msgspec

from swarmd.broker.config import Config
from swarmd.broker.core.swarm.links.link import LinkChanged, LinkEvent, LinkState
from swarmware.types.outage import LinkOutage, OutageCause, OutagePhase, OutageTable

LOOK_NS: Final = 100_000_000
"""Period in which the queue of a link that has recovered is read."""
SETTLE_NS: Final = 500_000_000
"""Time without a waiting frame after which a queue counts as drained: senders repeat what they could not send
within this time."""
SAVE_NS: Final = 500_000_000
"""Shortest time between two saves. Where the processor is short many links fall together: a file for each of
them would delay the next beacon, and more links would fall."""
DRAIN_MAX_NS: Final = 60_000_000_000
"""Time after which a queue that still has frames counts as too much traffic for the link."""

CAUSES: Final = {
    LinkEvent.SILENT: OutageCause.SILENT,
    LinkEvent.UNLISTED: OutageCause.HALF_OPEN,
    LinkEvent.RESTARTED: OutageCause.RESTARTED,
}
NEXT_PHASE: Final = {
    (OutagePhase.LOST, LinkState.HEARD): OutagePhase.RETURNING,
    (OutagePhase.LOST, LinkState.UP): OutagePhase.DRAINING,
    (OutagePhase.RETURNING, LinkState.UP): OutagePhase.DRAINING,
    (OutagePhase.RETURNING, LinkState.DOWN): OutagePhase.LOST,
    (OutagePhase.RETURNING, LinkState.HALF_OPEN): OutagePhase.LOST,
}
"""Phase of an outage after the link entered a state; any other state leaves it unchanged."""


class ReadBacklog(msgspec.Struct, frozen=True, gc=False):
    """Action: read what waits for the link to a neighbour, and call `on_backlog`."""

    hw: int


class SaveOutages(msgspec.Struct, frozen=True, gc=False):
    """Action: publish and keep the outages, which have changed."""


Action = ReadBacklog | SaveOutages


class _Outage(msgspec.Struct):
    platform: str
    unit: str
    hw: int
    cause: OutageCause
    worked_ns: int
    detected_ns: int
    phase: OutagePhase
    returned_ns: int | None = None
    up_ns: int | None = None
    waited_ns: int = 0
    """Newest instant at which frames waited."""
    drained_s: float | None = None
    frames: int = 0
    bytes: int = 0
    began_utc_ns: int = 0
    """0: not converted yet."""

    def record(self, now_ns: int, utc_ns: int) -> LinkOutage:
        """Record of the outage; the first call fixes the wall clock of its beginning."""
        self.began_utc_ns = self.began_utc_ns or utc_ns - (now_ns - self.worked_ns)
        return LinkOutage(
            self.platform,
            self.unit,
            self.hw,
            self.began_utc_ns,
            self.cause,
            self.phase,
            _seconds(self.worked_ns, self.detected_ns),
            None if self.returned_ns is None else _seconds(self.worked_ns, self.returned_ns),
            None
            if self.up_ns is None or self.returned_ns is None
            else _seconds(self.returned_ns, self.up_ns),
            self.drained_s,
            self.frames,
            self.bytes,
        )


class OutageLog:
    """The outages of all links of a node: present ones by neighbour, and the last finished ones."""

    def __init__(self, config: Config, kept: Iterable[LinkOutage] = ()) -> None:
        """`kept`: of a former session of this broker, the newest first."""
        self._limit = config.outages
        self._present: dict[int, _Outage] = {}
        self._over: deque[_Outage] = deque(maxlen=config.outages)
        self._kept = tuple(map(_interrupted, kept))[: config.outages]
        self._look_ns: int | None = None
        self._saved_ns: int | None = None
        self._save_ns: int | None = None
        """When changes are saved that came too soon after the last save, or None without such changes."""

    @property
    def lost(self) -> int:
        """Links that were up and are not."""
        return sum(one.phase is not OutagePhase.DRAINING for one in self._present.values())

    def on_link(self, change: LinkChanged, platform: str, unit: str, now_ns: int) -> list[Action]:
        """A link has changed its state; `platform`, `unit`: of the neighbour."""
        outage = self._present.get(change.hw)
        if change.before is LinkState.UP:
            # the link fell again while its queue drained; that is another outage
            if outage is not None:
                self._finish(outage)
            outage = self._present[change.hw] = _Outage(
                platform,
                unit,
                change.hw,
                CAUSES.get(change.event, OutageCause.SILENT),
                min(change.worked_ns, now_ns),
                now_ns,
                OutagePhase.LOST,
            )
        if outage is None:
            return []  # the two meet for the first time
        phase = NEXT_PHASE.get((outage.phase, change.after), outage.phase)
        # it was received for a moment only; the outage continues
        if phase is OutagePhase.LOST:
            outage.returned_ns = None
        elif outage.returned_ns is None:
            outage.returned_ns = now_ns
        if phase is OutagePhase.DRAINING and outage.phase is not phase:
            outage.up_ns = outage.waited_ns = now_ns
            self._look_ns = now_ns
        outage.phase = phase
        return self._changed(now_ns)

    def on_forgotten(self, hw: int, now_ns: int) -> list[Action]:
        """A node has left the swarm: the loss of its link is not an outage."""
        return [] if self._present.pop(hw, None) is None else self._changed(now_ns)

    @property
    def unsaved(self) -> bool:
        """Whether there are changes that wait to be saved."""
        return self._save_ns is not None

    def deadline_ns(self) -> int | None:
        """When the queues of links that have recovered are read next, or changes saved."""
        return min((due for due in (self._look_ns, self._save_ns) if due is not None), default=None)

    def on_timer(self, now_ns: int) -> list[Action]:
        """Reads the queues that drain, and saves what has changed since the last save."""
        actions: list[Action] = []
        if self._save_ns is not None and now_ns >= self._save_ns:
            actions += self._changed(now_ns)
        if self._look_ns is not None and now_ns >= self._look_ns:
            draining = [one.hw for one in self._present.values() if one.phase is OutagePhase.DRAINING]
            self._look_ns = now_ns + LOOK_NS if draining else None
            actions += [ReadBacklog(hw) for hw in draining]
        return actions

    def _changed(self, now_ns: int) -> list[Action]:
        """Saves a change at once, or later together with others."""
        # many links fall together where a node leaves its range; one write of the disk for all of them
        if self._saved_ns is not None and now_ns < self._saved_ns + SAVE_NS:
            self._save_ns = self._saved_ns + SAVE_NS
            return []
        self._saved_ns, self._save_ns = now_ns, None
        return [SaveOutages()]

    def on_backlog(self, hw: int, frames: int, size: int, now_ns: int) -> list[Action]:
        """Takes the frames and bytes that wait for a link now."""
        outage = self._present.get(hw)
        if outage is None or outage.up_ns is None or outage.phase is not OutagePhase.DRAINING:
            return []
        if frames:
            outage.waited_ns = now_ns
            outage.frames, outage.bytes = max(outage.frames, frames), max(outage.bytes, size)
            if now_ns - outage.up_ns < DRAIN_MAX_NS:
                return []
        # the queue may be empty between two frames; only a while without any shows that it has drained
        elif now_ns - outage.waited_ns < SETTLE_NS:
            return []
        else:
            outage.drained_s = _seconds(outage.up_ns, outage.waited_ns)
        self._finish(outage)
        return self._changed(now_ns)

    def _finish(self, outage: _Outage) -> None:
        outage.phase = OutagePhase.OVER
        del self._present[outage.hw]
        self._over.append(outage)

    def table(self, now_ns: int, utc_ns: int) -> OutageTable:
        """All outages, the newest first; `utc_ns`: the wall clock at `now_ns`."""
        present = sorted(self._present.values(), key=lambda one: one.detected_ns)
        own = [one.record(now_ns, utc_ns) for one in (*self._over, *present)]
        over = (*reversed(own), *self._kept)
        return OutageTable(over[: self._limit + len(present)])


def _interrupted(kept: LinkOutage) -> LinkOutage:
    if kept.phase is OutagePhase.OVER:
        return kept
    return msgspec.structs.replace(kept, phase=OutagePhase.INTERRUPTED)


def _seconds(from_ns: int, to_ns: int) -> float:
    return round((to_ns - from_ns) / 1e9, 3)
