"""Structures of trees in beacons: one datagram brings the structure of a node to all its neighbours."""

from typing import Final

import msgspec

from swarmd.broker.core.beacon.beacon import Beacon
from swarmd.broker.core.beacon.parts.structure_parts import StructurePart, question_bytes, structure_bytes
from swarmware.model.names import Address, hardware_id
from swarmware.types.net import StructureBroadcast, TreePlan

REPEAT_NS: Final = 600_000_000
"""Time for an answer, before a question is repeated: a node at rest sends a beacon every half second."""
QUESTIONS_MAX: Final = 100
"""Maximum questions of one beacon: a third of its body."""
RECEIVED_MAX: Final = 1024
"""Nodes whose newest structure is remembered, so that the tree gets it once."""


class BeaconStructures(msgspec.Struct, frozen=True, gc=False):
    """The sections of the next beacon about structures."""

    structure: StructurePart | None = None
    questions: tuple[int, ...] = ()

    @property
    def bytes(self) -> int:
        """Encoded size of both parts."""
        return structure_bytes(self.structure) + question_bytes(len(self.questions))


class StructureBroadcasts:
    """Decides which beacons have the own structure, or ask for others; takes the structures that arrive.

    The own structure is sent when it has changed, when a neighbour has asked, and to nodes that meet this one
    for the first time. A node that receives the question of another one does not ask, too.
    """

    def __init__(self, own_hw: int) -> None:
        self._own_hw = own_hw
        self._broadcast: StructureBroadcast | None = None
        self._is_due = False
        self._is_offered = False
        """The next beacon makes neighbours of nodes that do not have the structure."""
        self._needs: dict[int, int | None] = {}
        """Nodes whose structure is needed → when a node asked for it last."""
        self._received: dict[int, StructurePart] = {}
        """Newest structure of each node."""

    def set_plan(self, plan: TreePlan) -> list[StructureBroadcast]:
        """The tree has another structure, or needs structures of other nodes; returns the structures that
        arrived before the tree needed them."""
        if plan.broadcast != self._broadcast:
            self._is_due = self._broadcast is not None  # at the start neighbours ask
            self._broadcast = plan.broadcast
        before = self._needs
        needs = {hardware_id(name.platform, name.unit): str(name) for name in map(Address.parse, plan.needs)}
        self._needs = {hw: before.get(hw) for hw in needs}
        return [
            StructureBroadcast(name, part.epoch, part.digest, part.base, part.data)
            for hw, name in needs.items()
            if hw not in before and (part := self._received.get(hw)) is not None
        ]

    def offer(self) -> None:
        """The next beacon answers nodes that did not accept this node before and need its structure."""
        self._is_offered = True

    def is_due(self, now_ns: int) -> bool:
        """Whether the next beacon has something to send."""
        return (self._is_due and self._broadcast is not None) or bool(self._questions(now_ns))

    def _questions(self, now_ns: int) -> list[int]:
        """Nodes to ask for their structure now."""
        return [
            hw for hw, asked_ns in self._needs.items() if asked_ns is None or now_ns - asked_ns >= REPEAT_NS
        ]

    def compose(self, now_ns: int, room: int, *, has_neighbours: bool) -> BeaconStructures:
        """The sections of the next beacon about structures, in at most `room` bytes."""
        part: StructurePart | None = None
        is_offered, self._is_offered = self._is_offered, False
        if (self._is_due or is_offered) and (own := self._broadcast) is not None:
            if has_neighbours or is_offered:
                part = StructurePart(own.epoch, own.digest, own.base, own.data)
            # without room it stays due for the next beacon
            self._is_due = structure_bytes(part) > room
            if self._is_due:
                part = None
        limit = min(QUESTIONS_MAX, (room - structure_bytes(part) - question_bytes(1)) // 4 + 1)
        due = self._questions(now_ns)
        questions = tuple(due[: max(0, limit)])
        self._needs.update(dict.fromkeys(questions, now_ns))
        return BeaconStructures(part, questions)

    def on_beacon(self, hw: int, name: str, beacon: Beacon, now_ns: int) -> StructureBroadcast | None:
        """A beacon of the node with this name; returns its structure if that is new."""
        for asked in beacon.structure_questions:
            if asked == self._own_hw:
                self._is_due = True
            # another node has asked; the answer goes to all, so this node need not ask
            elif asked in self._needs:
                self._needs[asked] = now_ns
        part = beacon.structure
        if part is None:
            return None
        if hw in self._needs:
            self._needs[hw] = now_ns
        elif self._received.get(hw) == part:
            return None
        self._received.pop(hw, None)
        if len(self._received) >= RECEIVED_MAX:
            del self._received[next(iter(self._received))]
        self._received[hw] = part
        return StructureBroadcast(name, part.epoch, part.digest, part.base, part.data)
