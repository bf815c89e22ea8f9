"""Replica of the structure of one other platform: what is known of it, and what reports say about that."""

from enum import StrEnum
from typing import Final

from swarmd.tree.core.structure.index import Index
from swarmd.tree.core.structure.structure import version as tree_version


class StructureState(StrEnum):
    """Whether a structure has to be requested."""

    STALE = "stale"
    """The structure is unknown, or a report disagrees with it: changes have to be requested."""
    ASKING = "asking"
    """Changes are requested."""
    MISMATCHED = "mismatched"
    """The reply did not fit what is known: the full structure is due."""
    ASKING_FULL = "asking_full"
    """The full structure is requested."""
    UNVERIFIED = "unverified"
    """The structure may have changed while the platform was lost, or not followed."""
    CURRENT = "current"
    """The structure agrees with every report."""


class StructureEvent(StrEnum):
    """Events of a replicated structure."""

    ASKED = "asked"
    """A request was sent."""
    NO_REPLY = "no_reply"
    MISMATCH = "mismatch"
    """The reply could not be decoded, or has another digest than it says."""
    STORED = "stored"
    """The structure in the reply, or in a beacon, is stored."""
    AGREED = "agreed"
    """A report has the epoch and digest of what is known."""
    CONTRADICTED = "contradicted"
    """A report has another epoch or digest."""
    UNSEEN = "unseen"
    """The platform was lost, or is not followed: changes of it do not come here."""


TRANSITIONS: Final[dict[tuple[StructureState, StructureEvent], StructureState]] = {
    (StructureState.STALE, StructureEvent.ASKED): StructureState.ASKING,
    (StructureState.UNVERIFIED, StructureEvent.ASKED): StructureState.ASKING,
    (StructureState.MISMATCHED, StructureEvent.ASKED): StructureState.ASKING_FULL,
    (StructureState.ASKING, StructureEvent.NO_REPLY): StructureState.STALE,
    (StructureState.ASKING, StructureEvent.MISMATCH): StructureState.MISMATCHED,
    (StructureState.ASKING, StructureEvent.STORED): StructureState.CURRENT,
    (StructureState.ASKING_FULL, StructureEvent.NO_REPLY): StructureState.MISMATCHED,
    (StructureState.ASKING_FULL, StructureEvent.MISMATCH): StructureState.STALE,
    (StructureState.ASKING_FULL, StructureEvent.STORED): StructureState.CURRENT,
    (StructureState.STALE, StructureEvent.STORED): StructureState.CURRENT,
    (StructureState.MISMATCHED, StructureEvent.STORED): StructureState.CURRENT,
    (StructureState.UNVERIFIED, StructureEvent.STORED): StructureState.CURRENT,
    (StructureState.UNVERIFIED, StructureEvent.AGREED): StructureState.CURRENT,
    (StructureState.UNVERIFIED, StructureEvent.CONTRADICTED): StructureState.STALE,
    (StructureState.CURRENT, StructureEvent.CONTRADICTED): StructureState.STALE,
    (StructureState.CURRENT, StructureEvent.UNSEEN): StructureState.UNVERIFIED,
}
"""All transitions; any other event leaves the state unchanged.

A report that agrees does not undo a report that disagreed, because beacons repeat old versions for a while.
Reports that arrive during a request are compared with its reply.
"""
OUTDATED_MAX: Final = 16
"""Remembered versions before the known one: as many changes as fit into the delay of beacons."""
ASKING: Final = frozenset({StructureState.ASKING, StructureState.ASKING_FULL})
DUE: Final = frozenset({StructureState.STALE, StructureState.MISMATCHED})


class StructureReplica:
    """Structure of one other platform, its state, and the reports to compare it with."""

    __slots__ = ("_advertised", "_announced", "_before_request", "_outdated", "epoch", "index", "state")

    def __init__(self) -> None:
        self.state = StructureState.STALE
        self.epoch: int | None = None
        self.index: Index | None = None
        """Resources of the platform, or None if unknown."""
        self._advertised: int | None = None
        """Version of the tree in the newest beacon or route, or None if unknown."""
        self._before_request: int | None = None
        """Version that was advertised when the request was sent."""
        self._outdated: list[int | None] = []
        """Advertised versions that are older than the known structure, in their order; they are ignored."""
        self._announced: tuple[int, int | None] | None = None
        """Epoch and digest from the platform itself, not yet compared; no digest: of its epoch only."""

    @property
    def digest(self) -> int:
        """Digest of the known structure, or 0 if unknown."""
        return 0 if self.index is None else self.index.digest

    @property
    def is_asking(self) -> bool:
        """Whether a request has no reply yet."""
        return self.state in ASKING

    @property
    def is_due(self) -> bool:
        """Whether it has to be requested."""
        return self.state in DUE

    @property
    def is_mismatched(self) -> bool:
        """Whether the full structure is due, because changes did not fit."""
        return self.state is StructureState.MISMATCHED

    @property
    def is_advertised(self) -> bool:
        """Whether beacons show another version than the known structure has, or nothing is known."""
        return self.index is None or not self._is_past_or_known(self._advertised)

    @property
    def _known_version(self) -> int | None:
        return None if self.index is None else tree_version(self.epoch or 0, self.digest)

    @property
    def is_current(self) -> bool:
        """Whether it agrees with every report."""
        return self.state is StructureState.CURRENT

    # -- the exchange

    def on_asked(self) -> bool:
        """A request is sent; returns True if it is for the full structure."""
        # the reply is newer than all reports so far
        self._before_request, self._announced = self._advertised, None
        self._on(StructureEvent.ASKED)
        return self.state is StructureState.ASKING_FULL

    def on_no_reply(self) -> None:
        """The request had no reply in time."""
        self._on(StructureEvent.NO_REPLY)

    def on_mismatch(self) -> None:
        """The reply cannot be used."""
        self._on(StructureEvent.MISMATCH)

    def on_reply(self, epoch: int, index: Index) -> None:
        """The reply has this structure; reports that came since the request may disagree with it."""
        self._outdated = [self._before_request]
        self.epoch, self.index = epoch, index
        self._on(StructureEvent.STORED)

    def on_broadcast(self, epoch: int, index: Index) -> None:
        """A beacon has this structure, which is of the advertised version."""
        self.epoch, self.index = epoch, index
        self._on(StructureEvent.STORED)

    def is_of_advertised(self, epoch: int, digest: int) -> bool:
        """Whether a structure has the newest version that beacons show."""
        return self._advertised == tree_version(epoch, digest)

    # -- reports

    def on_advertised(self, version: int | None) -> None:
        """A beacon or route has this version of the tree, or None if it names no version."""
        if version != self._advertised:  # a structure may return to a version before this one
            past = self._outdated
            self._outdated = past[past.index(version) :] if version in past else []
        self._advertised = version

    def on_announced(self, epoch: int, digest: int | None) -> None:
        """The platform itself sent its epoch, and perhaps its digest."""
        self._announced = (epoch, digest)
        self.compare()

    def on_changes(self, index: Index) -> None:
        """A notification has changed the structure: beacons may show the versions before for a while."""
        if self._advertised != self._known_version:
            self._outdated = [*self._outdated, self._known_version][-OUTDATED_MAX:]
        else:
            self._outdated = [self._advertised]
        self.index = index

    def on_changes_lost(self) -> None:
        """Changes came that are not relative to the known structure."""
        self._on(StructureEvent.CONTRADICTED)

    def on_unseen(self) -> None:
        """Changes do not come here any more."""
        self._on(StructureEvent.UNSEEN)

    def compare(self) -> None:
        """Compare the known structure with the newest reports; during a request they wait for its reply."""
        if self.is_asking or self.index is None:
            return
        announced, self._announced = self._announced, None
        known = self._known_version
        is_refuted = announced is not None and not self._is(*announced)
        if is_refuted or not self._is_past_or_known(self._advertised):
            self._on(StructureEvent.CONTRADICTED)
        elif self._advertised == known or (announced is not None and announced[1] is not None):
            self._on(StructureEvent.AGREED)

    def _is_past_or_known(self, version: int | None) -> bool:
        return version in {None, self._known_version} or version in self._outdated

    def _is(self, epoch: int, digest: int | None) -> bool:
        return epoch == self.epoch and (digest is None or digest == self.digest)

    def _on(self, event: StructureEvent) -> None:
        """The only place that changes the state."""
        self.state = TRANSITIONS.get((self.state, event), self.state)
