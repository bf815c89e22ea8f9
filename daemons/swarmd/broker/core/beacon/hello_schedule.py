"""When a node's beacons have a hello, and what it says: identity, versions, and the periods it declares."""

from typing import Final, NamedTuple

import msgspec

from swarmd.broker.core.beacon.beacon import NEVER_NS, Hello, PlatformCode
from swarmd.broker.core.beacon.beacon_rate import IDLE_HZ, QuietRate
from swarmware.model.names import Address
from swarmware.types.net import TreePlan

HELLO_NS: Final = 2_000_000_000
"""Period of hellos."""
HELLO_CHANGING_NS: Final = 1_000_000_000
"""Period of hellos while links change, as others come into range, and once after a change of tree or
mission."""
SILENCE_NS: Final = 430_000_000
"""A node whose boards do not change sends a beacon in the first slot after this time: at 10 Hz every half
second, as a node without subscribers."""
FIRST_SILENCE_NS: Final = 350_000_000
"""Silence until hellos have declared the longer one: neighbours then tolerate the loss of one datagram."""
ROSTER_HELLOS: Final = 3
"""Consecutive beacons with a hello after a change of the roster: two may be lost."""
REST_HELLOS: Final = 3
"""Consecutive hellos that declare the longer period: one may be lost."""
SLOWER: Final = 1.25
"""A period that grew by this factor is declared at once, or neighbours would take the link down."""


class NodeIdentity(msgspec.Struct, frozen=True):
    """Identity of this node in its hellos."""

    hw: int
    platform: str
    unit: str
    kind: PlatformCode
    boot_id: int
    curve_public: bytes
    """Empty where the key is on the roster."""


class Moment(NamedTuple):
    """The state on which the hello of the next beacon depends."""

    now_ns: int
    sent_ns: int
    """When the last beacon was sent."""
    gap_ns: int
    """Time between the last two beacons."""
    slot_ns: int
    """Period of the present rate."""
    busy: bool
    """Boards have subscribers, or are relayed."""
    is_changing: bool
    """Links have come or gone."""
    is_new: bool
    """Neighbours may still use the former session."""
    listing_ns: int
    """Period in which every neighbour is listed."""


class HelloSchedule:
    """Hellos of a node: their schedule and contents."""

    def __init__(self, identity: NodeIdentity, busy_hz: float) -> None:
        self.identity = identity
        self.tcp_port = 0
        self.frame_port = 0
        self.declared_ns = 0
        """Period that the last hello declared."""
        self.quiet_rate = QuietRate()
        self._busy_hz = busy_hz
        self._plan = TreePlan(0)
        self._roster_version = 0
        self._announcements = 0
        """Beacons from the next one on that have a hello, as the roster has changed."""
        self._rest_hellos = 0
        """Consecutive hellos that declared the period of a node at rest."""
        self._announced_ns = NEVER_NS
        self._replanned_ns = NEVER_NS
        """Instant of the last change of tree or mission, which hellos announce."""

    def schedule(self) -> None:
        """Adds a hello, with name and session, to the next beacon."""
        self._announced_ns = NEVER_NS

    def set_plan(self, plan: TreePlan, now_ns: int) -> None:
        """Announces a change of tree or mission."""
        if plan.tree_version != self._plan.tree_version or plan.mission != self._plan.mission:
            self._announced_ns = NEVER_NS
            self._replanned_ns = now_ns
        self._plan = plan

    def set_roster_version(self, version: int) -> None:
        """Sets the version of the roster that hellos show."""
        # at the start the first hellos have it anyway
        self._announcements = ROSTER_HELLOS if self._roster_version else 0
        self._roster_version = version

    @property
    def is_scheduled(self) -> bool:
        """Whether the next beacon has a hello that must not wait."""
        return self._announced_ns == NEVER_NS or self._announcements > 0

    def silence_ns(self) -> int:
        """Longest time without a beacon that neighbours tolerate."""
        return SILENCE_NS if self._rest_hellos >= REST_HELLOS else FIRST_SILENCE_NS

    def next_hello(self, at: Moment) -> Hello | None:
        """The hello of the next beacon, or None if it needs no hello."""
        # beacons leave in whole slots, so the longest silence is rounded up to one
        rest_ns = -(-SILENCE_NS // at.slot_ns) * at.slot_ns
        # a beacon was skipped; the node rests, which hellos declare before the silence grows
        left_out = at.sent_ns != NEVER_NS and at.now_ns - at.sent_ns >= FIRST_SILENCE_NS > at.slot_ns
        rests = at.busy and left_out
        period_ns = rest_ns if rests else max(at.slot_ns, min(at.gap_ns, rest_ns))
        # the longer period is declared at the present rate first; a neighbour that missed it would take the
        # link down
        falls = not at.busy and not at.is_changing and self.quiet_rate.is_falling
        if falls:
            period_ns = max(period_ns, round(1e9 / IDLE_HZ))
        elif at.busy or at.is_changing:
            self.quiet_rate.on_change()
        if self._waits(at, rests=rests, falls=falls) and period_ns <= SLOWER * self.declared_ns:
            return None
        if rests:
            self._rest_hellos += 1
        elif period_ns < rest_ns:
            self._rest_hellos = 0
        if falls:
            self.quiet_rate.on_hello()
        self._announced_ns = at.now_ns
        self._announcements = max(0, self._announcements - 1)
        self.declared_ns = period_ns
        return self._hello(at)

    def _waits(self, at: Moment, *, rests: bool, falls: bool) -> bool:
        # half a period early: at 10 Hz every tenth, or twentieth, beacon has a hello
        calm = not at.is_changing and at.now_ns - self._replanned_ns >= HELLO_NS
        again_ns = HELLO_NS if calm else HELLO_CHANGING_NS
        waits = at.now_ns - self._announced_ns < again_ns - round(0.5e9 / self._busy_hz)
        waits = waits and not self._announcements
        waits = waits and not at.is_new  # until then neighbours may use the former session
        waits = waits and not falls
        return waits and not (rests and self._rest_hellos < REST_HELLOS)

    def _hello(self, at: Moment) -> Hello:
        who = self.identity
        return Hello(
            who.boot_id,
            at.now_ns // 1000 >> 32,
            self.tcp_port,
            self._plan.tree_version & 0xFFFF_FFFF,
            self._plan.mission & 0xFFFF_FFFF,
            who.kind,
            str(Address(who.platform, who.unit)),
            who.curve_public,
            min(self.declared_ns // 1_000_000, 0xFFFF),
            min(at.listing_ns // 1_000_000, 0xFFFF),
            self.frame_port,
            self._roster_version,
        )
