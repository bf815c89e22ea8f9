"""Structures of trees in beacons: one datagram brings the structure of a node to all its neighbours."""

from typing import Final

import msgspec

from swarmd.broker.core.admission.signing_keys import SigningKeys
from swarmd.broker.core.beacon.beacon import Beacon
from swarmd.broker.core.beacon.structure_parts import (
    StructurePart,
    question_bytes,
    signed_content,
    structure_bytes,
)
from swarmware.model.names import Address, hardware_id
from swarmware.transport.sodium import verify
from swarmware.types.net import Refused, StructureBroadcast, TreePlan

REPEAT_NS: Final = 600_000_000
"""Time for an answer, before a question is repeated: a node at rest sends a beacon every half second."""
QUESTIONS_MAX: Final = 100
"""Maximum questions of one beacon: a third of its body."""
RECEIVED_MAX: Final = 1024
"""Nodes whose newest structure is remembered, so that it is verified once."""


class BeaconStructures(msgspec.Struct, frozen=True, gc=False):
    """What the next beacon has of structures."""

    structure: StructurePart | None = None
    questions: tuple[int, ...] = ()

    @property
    def bytes(self) -> int:
        """Encoded size of both parts."""
        return structure_bytes(self.structure) + question_bytes(len(self.questions))


class StructureBroadcasts:
    """Decides which beacons have the own structure, or questions for those of others; verifies what others
    send.

    The own structure is sent when it has changed, when a neighbour has asked, and to nodes that meet this one
    for the first time. A node that receives the question of another one does not ask, too. In a beacon that
    is signed as a whole a structure has no signature of its own.
    """

    def __init__(self, own_hw: int, session: int, keys: SigningKeys | None, refused: Refused) -> None:
        """`keys`: None or open ones: nothing is signed."""
        self._own_hw = own_hw
        self._session = session
        self._keys = None if keys is None or keys.is_open else keys
        self._refused = refused
        self._broadcast: StructureBroadcast | None = None
        self._signature = b""
        """Of the own structure, made for the first beacon that is not signed."""
        self._is_due = False
        self._is_offered = False
        """The next beacon makes neighbours of nodes that do not have the structure."""
        self._needs: dict[int, int | None] = {}
        """Nodes whose structure is needed → when a node asked for it last."""
        self._received: dict[int, StructurePart] = {}
        """Newest structure of a node that was verified, without its signature."""

    def set_plan(self, plan: TreePlan) -> list[StructureBroadcast]:
        """The tree has another structure, or needs those of other nodes; returns those that were received
        before it needed them."""
        if plan.broadcast != self._broadcast:
            self._is_due = self._broadcast is not None  # at the start neighbours ask
            self._broadcast, self._signature = plan.broadcast, b""
        before = self._needs
        needs = {hardware_id(name.platform, name.unit): str(name) for name in map(Address.parse, plan.needs)}
        self._needs = {hw: before.get(hw) for hw in needs}
        return [
            StructureBroadcast(name, part.epoch, part.digest, part.base, part.data)
            for hw, name in needs.items()
            if hw not in before and (part := self._received.get(hw)) is not None
        ]

    def offer(self) -> None:
        """The next beacon answers nodes that did not accept this one before: they need its structure."""
        self._is_offered = True

    def is_due(self, now_ns: int) -> bool:
        """Whether the next beacon has something to send."""
        return (self._is_due and self._broadcast is not None) or bool(self._questions(now_ns))

    def _questions(self, now_ns: int) -> list[int]:
        """Nodes to ask for their structure now."""
        return [
            hw for hw, asked_ns in self._needs.items() if asked_ns is None or now_ns - asked_ns >= REPEAT_NS
        ]

    def compose(
        self, now_ns: int, room: int, *, has_neighbours: bool, is_signed: bool = False
    ) -> BeaconStructures:
        """What the next beacon has of structures, in at most `room` bytes; `is_signed`: as a whole."""
        part: StructurePart | None = None
        is_offered, self._is_offered = self._is_offered, False
        if (self._is_due or is_offered) and self._broadcast is not None:
            if has_neighbours or is_offered:
                part = self._own_part(self._broadcast, is_signed=is_signed)
            self._is_due = structure_bytes(part) > room
            if self._is_due:
                part = None
        limit = min(QUESTIONS_MAX, (room - structure_bytes(part) - question_bytes(1)) // 4 + 1)
        due = [
            hw for hw, asked_ns in self._needs.items() if asked_ns is None or now_ns - asked_ns >= REPEAT_NS
        ]
        questions = tuple(due[: max(0, limit)])
        self._needs.update(dict.fromkeys(questions, now_ns))
        return BeaconStructures(part, questions)

    def _own_part(self, broadcast: StructureBroadcast, *, is_signed: bool) -> StructurePart:
        part = StructurePart(broadcast.epoch, broadcast.digest, broadcast.base, broadcast.data)
        if self._keys is None or is_signed:
            return part
        if not self._signature:
            self._signature = self._keys.sign(signed_content(self._own_hw, self._session, part))
        return msgspec.structs.replace(part, signature=self._signature)

    def on_beacon(
        self, hw: int, name: str, session: int, beacon: Beacon, now_ns: int, *, is_signed: bool = False
    ) -> StructureBroadcast | None:
        """A beacon of the node with this name, in this session of its broker; returns its structure, if that
        is new and genuine. `is_signed`: the whole beacon, by its sender."""
        for asked in beacon.structure_questions:
            if asked == self._own_hw:
                self._is_due = True
            elif asked in self._needs:
                self._needs[asked] = now_ns
        part = beacon.structure
        if part is None:
            return None
        content = msgspec.structs.replace(part, signature=b"")
        if hw in self._needs:
            self._needs[hw] = now_ns
        elif self._received.get(hw) == content:
            return None
        if not is_signed and not self._is_genuine(hw, Address.parse(name).platform, session, part):
            self._refused.spoofed += 1
            return None
        self._received.pop(hw, None)
        if len(self._received) >= RECEIVED_MAX:
            del self._received[next(iter(self._received))]
        self._received[hw] = content
        return StructureBroadcast(name, part.epoch, part.digest, part.base, part.data)

    def _is_genuine(self, hw: int, platform: str, session: int, part: StructurePart) -> bool:
        if self._keys is None:
            return True
        public = self._keys.sign_public_of(platform)
        return public is not None and verify(public, part.signature, signed_content(hw, session, part))
