"""Exchange of the roster with neighbours: a node that sees a higher version asks one of those that show it.

Neighbours show their version in their hellos. A node asks over its CURVE connection, another neighbour when
no answer came, verifies the root's signature and shows the new version at once; so a change crosses the swarm
hop by hop, and in a dense cell each node gets it once. A node that missed a rotation cannot read the beacons
of the others; they open its beacons with the kept former key, only to offer it the roster.
"""

import logging
from collections.abc import Callable, Iterable
from typing import Final, Protocol

import msgspec

from swarmd.broker.core.beacon.beacon import NEVER_NS, Beacon
from swarmd.broker.core.membership.group_epochs import GroupEpochs
from swarmd.broker.core.membership.roster import roster_update
from swarmd.broker.core.membership.roster.roster_update import RosterOffer, RosterQuestion, RosterUpdate
from swarmware.errors import ConfigError, Denied, WireError
from swarmware.model.names import hardware_id
from swarmware.transport.security.roster import Roster, RosterChange, RosterMember
from swarmware.transport.security.seal import GroupKey

SPREAD_EACH_NS: Final = 3_000_000
"""Questions of a cell's nodes are spread over this time for each neighbour: the first ones to have the roster
answer others."""
SPREAD_MAX_NS: Final = 300_000_000
ANSWER_NS: Final = 400_000_000
"""Time for an answer, after which another neighbour is asked."""
AGAIN_NS: Final = 200_000_000
"""Minimum time between two answers to one node."""
OFFER_NS: Final = 2_000_000_000
"""Minimum time between two offers to one node."""
REFUSED_NS: Final = 10_000_000_000
"""Time for which a neighbour is not asked whose roster was refused."""
FORMER_ROSTERS: Final = 4
"""Rosters before the present one, from which a difference is made."""
UNANSWERED_MAX: Final = 5
"""Questions without an answer, after which a neighbour is not asked until it shows its version again."""
FAREWELLS: Final = 4
"""Neighbours, in the mean, that send a revoked one the roster."""

log = logging.getLogger("swarm.broker")


class RosterKeys(Protocol):
    """The keys of a node: they verify a roster and take the group key out of it."""

    @property
    def roster(self) -> Roster | None:
        """The roster in force, or None if no keys were made."""
        ...

    @property
    def signed(self) -> bytes:
        """Text of the roster with the root's signature."""
        ...

    @property
    def group(self) -> GroupKey:
        """The newest group key."""
        ...

    @property
    def former(self) -> tuple[GroupKey, ...]:
        """Group keys before that."""
        ...

    def apply(self, text: bytes) -> RosterChange | None:
        """Take a signed roster, or None if it is not newer."""
        ...


class SendRoster(msgspec.Struct, frozen=True):
    """Action: send a message about the roster to a node."""

    hw: int
    platform: str
    payload: bytes
    host: str = ""
    """Address of a node that is not a neighbour, or "" for the address of its hello."""
    port: int = 0
    curve_public: bytes = b""
    """Key of a node that was revoked just now, or "" for its key on the roster."""


class ApplyRoster(msgspec.Struct, frozen=True):
    """Action: store the roster that the keys have taken, and act on who came and went."""

    change: RosterChange


RosterAction = SendRoster | ApplyRoster


class _Version(msgspec.Struct):
    version: int


class _Shown(msgspec.Struct, gc=False):
    """Version of the roster that a neighbour shows, and the questions to it."""

    platform: str
    version: int
    refused_ns: int = NEVER_NS
    asked_ns: int = NEVER_NS
    unanswered: int = 0
    host: str = ""
    port: int = 0


class _Offer(msgspec.Struct, frozen=True, gc=False):
    """The last offer of the roster to a node that missed a rotation."""

    at_ns: int
    by_former_key: bool
    """For a key that was replaced; the next offer is for the present key."""


class RosterExchange:
    """Version of the roster at this node and at its neighbours, and the messages between them."""

    def __init__(self, keys: RosterKeys, own_hw: int, chance: Callable[[], float]) -> None:
        assert keys.roster is not None, "a node without keys exchanges no roster"
        self._keys = keys
        self._own_hw = own_hw
        self._chance = chance
        self.port = 0
        """Port of the own ZeroMQ socket."""
        self.epochs = GroupEpochs(keys.group)
        self._roster: Roster = keys.roster
        self._before: list[Roster] = []
        self._shown: dict[int, _Shown] = {}
        self._ask_ns: int | None = None
        """Instant of the next question, or None if no neighbour shows a higher version."""
        self._whole = False
        """A difference did not fit: ask for the whole roster."""
        self._answered_ns: dict[int, int] = {}
        self._offers: dict[int, _Offer] = {}
        """Last offers to nodes that missed a rotation, which are not neighbours yet."""
        self._revoked_platforms: frozenset[str] = frozenset()
        self._excluded: set[int] = set()
        self._exclude()

    @property
    def version(self) -> int:
        """Version of the own roster."""
        return self._roster.version

    def former_key(self, mark: int) -> GroupKey | None:
        """The kept former key with this mark, which opens beacons of nodes that missed a rotation."""
        return next((key for key in self._keys.former if key.mark == mark), None)

    # revoked members

    def excludes(self, hw: int) -> bool:
        """Whether a hardware id belongs to a revoked platform."""
        return hw in self._excluded

    def excludes_name(self, hw: int, name: str) -> bool:
        """Whether the name in a hello is of a revoked platform; then its unit is excluded from now on."""
        if name.partition(".")[0] not in self._revoked_platforms:
            return False
        self._excluded.add(hw)
        return True

    def without_excluded(self, beacon: Beacon) -> Beacon:
        """The beacon without what it has about revoked platforms."""
        out = self._excluded
        if not out or not (
            any(row.hw in out for row in beacon.rows)
            or any(row.hw in out for row in beacon.members)
            or any(value.origin_hw in out for value in beacon.relays)
        ):
            return beacon
        return msgspec.structs.replace(
            beacon,
            rows=tuple(row for row in beacon.rows if row.hw not in out),
            members=tuple(row for row in beacon.members if row.hw not in out),
            relays=tuple(value for value in beacon.relays if value.origin_hw not in out),
        )

    def _exclude(self) -> None:
        valid = {member.platform for member in self._roster.valid()}
        self._revoked_platforms = frozenset(each.platform for each in self._roster.members) - valid
        self._excluded = {hardware_id(platform) for platform in self._revoked_platforms}
        self._excluded.discard(self._own_hw)

    # input

    def on_shown(self, hw: int, platform: str, version: int, now_ns: int) -> None:
        """A neighbour shows its version in a hello, or in a message."""
        shown = self._shown.get(hw)
        if shown is None:
            shown = self._shown[hw] = _Shown(platform, version)
        shown.version = version
        shown.unanswered = 0
        # a random pause; otherwise all neighbours of a new version ask at the same instant
        if version > self.version and self._ask_ns is None:
            spread_ns = min(SPREAD_EACH_NS * len(self._shown), SPREAD_MAX_NS)
            self._ask_ns = now_ns + round(spread_ns * self._chance())

    def is_offer_due(self, hw: int, now_ns: int) -> bool:
        """Whether nothing was offered to this node in the last seconds."""
        offer = self._offers.get(hw)
        return offer is None or now_ns - offer.at_ns >= OFFER_NS

    def on_late(
        self, hw: int, name: str, version: int, host: str, port: int, now_ns: int
    ) -> list[RosterAction]:
        """Takes a beacon of a former key epoch; offers the roster to its sender, if that is a member.

        A platform that was revoked while it was away could not ask for the roster, so it gets the
        roster. A platform whose key was replaced gets it every other time, because it may have the former
        key. `version`: of its roster.
        """
        platform = name.partition(".")[0]
        member = self._roster.find(platform)
        if not port or not self.is_offer_due(hw, now_ns):
            return []
        # ids can be invented by a holder of the former key, so the table is emptied when it is larger than
        # the swarm
        if len(self._offers) > len(self._roster.members):
            self._offers.clear()
        last = self._offers.get(hw)
        former = [each for each in self._roster.members if each.platform == platform and each != member]
        by_former_key = member is None or (bool(former) and (last is None or not last.by_former_key))
        self._offers[hw] = _Offer(now_ns, by_former_key)
        if by_former_key:
            return self._for_revoked(hw, former, version, host, port)
        return [
            SendRoster(hw, platform, roster_update.encode(RosterOffer(self.version, self.port)), host, port)
        ]

    def _for_revoked(
        self, hw: int, former: list[RosterMember], version: int, host: str, port: int
    ) -> list[RosterAction]:
        """The roster for a platform with one of these revoked keys and an older roster, from some of those in
        range."""
        if not former or version >= self.version or self._chance() >= FAREWELLS / max(1, len(self._shown)):
            return []
        key = former[int(self._chance() * len(former))]
        return [SendRoster(hw, key.platform, self._update_from(0), host, port, curve_public=key.curve_public)]

    def on_message(
        self, hw: int, platform: str, payload: bytes | memoryview, host: str, now_ns: int
    ) -> list[RosterAction]:
        """Takes a message of a member, over a connection that only its key opens. `host`: its address.

        Raises: WireError for a malformed one; ConfigError or Denied for a roster that is refused.
        """
        message = roster_update.decode(payload)
        match message:
            case RosterUpdate():
                return self._on_update(hw, message, now_ns)
            case RosterQuestion(have):
                if have < self.version:
                    return self._answer(hw, platform, message, host, now_ns)
        version = message.version if isinstance(message, RosterOffer) else message.have
        self.on_shown(hw, platform, version, now_ns)
        shown = self._shown[hw]
        shown.host, shown.port = host, message.port
        return self.advance(now_ns)

    def _answer(
        self, hw: int, platform: str, question: RosterQuestion, host: str, now_ns: int
    ) -> list[RosterAction]:
        if now_ns - self._answered_ns.get(hw, NEVER_NS) < AGAIN_NS:
            return []
        # units share the key of their platform, so there may be more askers than members
        if len(self._answered_ns) > 2 * len(self._roster.members):
            self._answered_ns.clear()
        self._answered_ns[hw] = now_ns
        return [SendRoster(hw, platform, self._update_from(question.have), host, question.port)]

    def _update_from(self, have: int) -> bytes:
        # a difference is small; without its base the whole roster is sent
        base = next((roster for roster in self._before if roster.version == have), None)
        return roster_update.encode(roster_update.make_update(base, self._roster, self._keys.signed))

    def _on_update(self, hw: int, update: RosterUpdate, now_ns: int) -> list[RosterAction]:
        version = update.version if update.base else _version_of(update.whole)
        if version == self.version:
            return []  # another neighbour was faster
        if version < self.version:
            raise ConfigError(f"roster {version} is older than {self.version}, which is in force")
        try:
            return self.on_text(roster_update.merge(self._roster, update), now_ns)
        except (WireError, ConfigError, Denied):
            # a difference that does not fit proves nothing against the neighbour; ask for the whole roster
            self._whole = bool(update.base)
            if not update.base and hw in self._shown:
                self._shown[hw].refused_ns = now_ns
            raise
        finally:
            self._plan_question(now_ns)

    def on_text(self, text: bytes, now_ns: int) -> list[RosterAction]:
        """Takes a signed roster of a neighbour or an operator; an older or equal one changes nothing.

        Raises: ConfigError when it is damaged, Denied when the root did not sign it.
        """
        before = self._roster
        change = self._keys.apply(text)
        if change is None:
            return []
        # bases of the differences for neighbours that are some versions behind
        self._before = [before, *self._before][:FORMER_ROSTERS]
        self._roster = change.roster
        self._whole = False
        # a revoked node does not get the new key
        if change.rotated and not change.revoked_self:
            self.epochs.rotate(self._keys.group, now_ns)
        self._exclude()
        self._plan_question(now_ns)
        return [*self._farewells(change), ApplyRoster(change)]

    def _farewells(self, change: RosterChange) -> list[RosterAction]:
        """The roster for revoked neighbours, which from now on are refused and could not ask for it."""
        near = max(1, len(self._shown))
        out: list[RosterAction] = []
        for member in change.gone:
            for hw, shown in list(self._shown.items()):
                if shown.platform == member.platform and self._roster.find(member.platform) is None:
                    del self._shown[hw]
                    if not change.revoked_self and self._chance() < FAREWELLS / near:
                        update = self._update_from(shown.version)
                        curve = member.curve_public
                        out.append(SendRoster(hw, member.platform, update, curve_public=curve))
        return out

    def forget(self, hw: int) -> None:
        """Forgets a neighbour whose link is down."""
        self._shown.pop(hw, None)

    # time

    def deadline_ns(self) -> int | None:
        """Instant of the next question."""
        return self._ask_ns

    def advance(self, now_ns: int) -> list[RosterAction]:
        """Asks a neighbour, if that is due."""
        if self._ask_ns is None or now_ns < self._ask_ns:
            return []
        candidates = [
            (shown.asked_ns, self._chance(), hw)
            for hw, shown in self._shown.items()
            if shown.version > self.version and now_ns - shown.refused_ns >= REFUSED_NS
        ]
        if not candidates:
            self._ask_ns = None
            return []
        _, _, hw = min(candidates)
        shown = self._shown[hw]
        shown.asked_ns = now_ns
        shown.unanswered += 1
        if shown.unanswered > UNANSWERED_MAX:
            del self._shown[hw]  # until it shows its version again
        self._ask_ns = now_ns + ANSWER_NS
        question = RosterQuestion(0 if self._whole else self.version, self.port)
        return [SendRoster(hw, shown.platform, roster_update.encode(question), shown.host, shown.port)]

    def _plan_question(self, now_ns: int) -> None:
        behind = any(
            shown.version > self.version and now_ns - shown.refused_ns >= REFUSED_NS
            for shown in self._shown.values()
        )
        self._ask_ns = now_ns if behind else None

    def switch_epoch(self, neighbours: Iterable[int], now_ns: int) -> bool:
        """Seal with the new group key, if it is time; `neighbours`: those whose links are up."""
        if not self.epochs.is_switching:
            return False
        needed = self._roster.version
        have = all(
            (shown := self._shown.get(hw)) is not None and shown.version >= needed for hw in neighbours
        )
        return self.epochs.switch(have, now_ns)


def _version_of(text: bytes) -> int:
    try:
        return msgspec.json.decode(text.partition(b"\n")[0], type=_Version).version
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise ConfigError(f"roster: expected a line of JSON with its version: {error}") from error
