"""Missions between processes and platforms: order and receipt, and the state that implements barriers."""

from typing import ClassVar, Final, Self

import msgspec

from swarmware.errors import WireError
from swarmware.model.open_enum import OpenEnum
from swarmware.model.platform_kind import NO_KIND, PlatformKind
from swarmware.types.quantised import Form, Part, packer
from swarmware.types.reaction import ReactionState
from swarmware.types.registry import register


class MissionPhase(OpenEnum):
    """Phase of a platform's mission; the values are the states of its board."""

    IDLE = "idle"
    READY = "ready"
    """The order is accepted; the platform waits until all members have accepted theirs."""
    RUNNING = "running"
    ENDING = "ending"
    """The blocks that still run are being cancelled."""
    RECOVERING = "recovering"
    """A built-in mission brings the vehicle to safety."""
    DONE = "done"
    FAILED = "failed"
    ABORTED = "aborted"
    SUSPENDING = "suspending"
    """The mission makes way for another one: its running blocks are being cancelled."""
    SUSPENDED = "suspended"
    """The mission has made way; its marking is kept until it continues."""


PHASES: Final = tuple(MissionPhase)
"""Numbers of the states on the wire, by their index."""
NOT_STARTED: Final = MissionPhase.IDLE
"""State of a member whose order was withdrawn before the mission began."""
INACTIVE: Final = frozenset({NOT_STARTED, MissionPhase.DONE, MissionPhase.FAILED, MissionPhase.ABORTED})
"""States without an active mission: it has not started or has ended."""
KINDS: Final = (NO_KIND, *PlatformKind)
"""Kinds of platform; the index is the number on the wire."""
HASH_DIGITS: Final = 8
"""Digits of a mission's hash on its board: enough to distinguish the versions of one mission."""

_HEAD_PARTS: Final = (
    Part("epoch", "u32", "epoch"),
    Part("hash", "u32", f"the {HASH_DIGITS} hexadecimal digits of the hash as a number; 0 without a mission"),
    Part("state", "u8", "place of the state in " + ", ".join(PHASES)),
    Part("kind", "u8", "place of the kind in none, " + ", ".join(KINDS[1:])),
    Part("progress", "u8", "progress_ratio in 1/255"),
)
_HEAD: Final = packer(_HEAD_PARTS)

ParamValue = bool | int | float | str | tuple[tuple[float, ...], ...]
"""Value of a mission parameter: a number, a text, yes or no, or points in metres."""


@register
class MissionFile(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One file of a mission, by content: issuer and members share no disk."""

    name: str
    text: str


@register
class MissionTask(msgspec.Struct, frozen=True):
    """One instruction to the swarm (`sys/mission/task` at the ground station)."""

    name: str = ""
    """Name of a mission in the ground station's store, or a name for the files."""
    files: tuple[MissionFile, ...] = ()
    """The mission by content; without files, the stored mission of this name."""
    params: dict[str, ParamValue] = {}
    """Parameters that replace the defaults in the manifest."""
    members: tuple[str, ...] = ()
    """Platforms that take part; () assigns all known platforms."""
    priority: int | None = None
    """Priority of the run, or None for the priority in the mission."""


@register
class OrderReceipt(msgspec.Struct, frozen=True):
    """Result of the order to one platform (event `mission/orders`, logged at the ground station)."""

    mission: str
    epoch: int
    platform: str
    role: str
    sent_ns: int
    """Ground station's hardware clock when the order left."""
    acked_ns: int
    """Ground station's hardware clock when the reply arrived, or 0 without a reply."""
    received_ns: int
    """Platform's own hardware clock when its broker received the order from the link, or 0 if unknown."""
    accepted: bool
    reasons: tuple[str, ...] = ()
    """Reasons of a refusal."""
    waits: str = ""
    """Why an accepted order waits, or "" if it does not."""


@register
class Member(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A member of the ensemble."""

    platform: str
    role: str
    kind: PlatformKind


@register
class LeftOut(msgspec.Struct, frozen=True):
    """A known platform without a part in the mission."""

    platform: str
    why: str


@register
class MissionPlan(msgspec.Struct, frozen=True):
    """Assignment of roles for an instruction, without an order (`sys/mission/plan`)."""

    mission: str
    hash: str
    members: tuple[Member, ...]
    left_out: tuple[LeftOut, ...] = ()
    """Known platforms without a part, or none if the instruction names the members."""
    warnings: tuple[str, ...] = ()
    """Warnings of the check."""


@register
class TaskAnswer(msgspec.Struct, frozen=True):
    """Result of an instruction."""

    mission: str
    hash: str
    epoch: int
    accepted: bool
    """Whether all members accepted; otherwise the mission was not started."""
    orders: tuple[OrderReceipt, ...]
    left_out: tuple[LeftOut, ...] = ()
    """Known platforms without a part, with the reason."""
    instructed_ns: int = 0
    """Ground station's hardware clock when the instruction was given or arrived there."""
    warnings: tuple[str, ...] = ()
    """Warnings of the check."""


@register
class MissionOrder(msgspec.Struct, frozen=True, array_like=True):
    """The order to one platform (`cmd/mission`): its part, and all members."""

    mission: str
    """Name."""
    hash: str
    """BLAKE2b-128 of all files of the mission, hex: the same at every member."""
    epoch: int
    """Number of the run, unique at this ground station."""
    role: str
    file: str
    """Name of the role's file, for errors."""
    text: str
    """BDL text of the role."""
    text_hash: str
    """BLAKE2b-128 of the text, hex."""
    members: tuple[Member, ...]
    """Members in the order that determines which one opens a barrier."""
    params: dict[str, ParamValue]
    issuer: str
    issued_ns: int
    """Time of the order on the issuer's hardware clock."""
    expires_ns: int
    """Expiry on the issuer's hardware clock; an order that arrives later is refused."""
    reactions: str = ""
    """Reactions of the mission as a JSON array of rows, or "" without reactions."""
    priority: int = 0
    """Priority of the run, the same at all members."""


@register
class MissionReceipt(msgspec.Struct, frozen=True, array_like=True):
    """Reply to an order: whether it is accepted, with the reasons of a refusal."""

    accepted: bool
    received_ns: int
    """Receiver's hardware clock when its broker received the order from the link, before its check."""
    reasons: tuple[str, ...] = ()
    waits: str = ""
    """Why an accepted order waits, or "" if it does not."""


@register
class MissionAbort(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Stop the mission (`cmd/abort`; `sys/mission/abort` passes it on to all members)."""

    reason: str
    then: str = ""
    """Built-in mission that takes over (land | hold | return), or "" for the mission's own `on_failure`."""
    epoch: int = 0
    """Run to be aborted, which may also wait or be suspended; 0 aborts all runs."""


@register
class PriorityChange(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Change the priority of a run (`cmd/priority`; `sys/mission/prioritize` passes it on to all members)."""

    epoch: int
    priority: int


ASKS: Final = "asks the operator: "
"""Start of the question of a UserBreakpoint in the text of a mission's state, after the name of the block."""


@register
class BreakpointAnswer(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Answer of the operator to the question of a UserBreakpoint (`sys/mission/answer`)."""

    proceed: bool
    """Whether the mission continues; false ends the block with the error `stopped`."""
    block: str = ""
    """Name of the block, or "" if a single block asks."""


@register
class QueuedMission(msgspec.Struct, frozen=True):
    """A run in the queue of a platform."""

    epoch: int
    """Number of the run, which `mission cancel` and `mission prioritize` take."""
    mission: str
    role: str
    priority: int
    state: str
    """waiting | suspended, or the phase of the run that is played."""
    since_ns: int
    """Own hardware clock when the run was accepted."""
    ordered_by: str = ""
    why: str = ""
    """Why it waits, or was suspended."""


@register
class MissionQueue(msgspec.Struct, frozen=True):
    """The runs of a platform in the order in which they are played (`sys/mission/queue`)."""

    platform: str
    runs: tuple[QueuedMission, ...]


@register
class ManoeuvreRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Start a manoeuvre of one vehicle, which ends its mission (`sys/mission/manoeuvre`)."""

    name: str
    """takeoff | goto."""
    params: dict[str, float]
    """takeoff: altitude_m, speed_m_s; goto: x_m, y_m, z_m, speed_m_s; without z_m at the present height."""
    reason: str = ""
    force: bool = False
    """takeoff: whether to arm although `health/ready` names items that are not ready."""


@register
class AbortAnswer(msgspec.Struct, frozen=True):
    """Platforms that were ordered to abort."""

    acknowledged: tuple[str, ...] = msgspec.field(name="told")
    silent: tuple[str, ...]
    """Members that did not acknowledge."""


@register
class Arrival(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The platform waits at this barrier."""

    barrier: str
    visit: int
    """Counts from 1, for barriers in loops."""


@register
class BarrierResult(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The result of one visit of a barrier."""

    barrier: str
    visit: int
    leave_ns: int | None
    """Instant at which all leave, on the clock of the platform that publishes it, or None if it is broken."""
    by: int = 0
    """Index of the member that decided it: an instant that another member relays was converted twice."""


@register
class MissionState(msgspec.Struct, frozen=True, array_like=True):
    """State of a platform's mission (board `mission/state`, on change at most 10 Hz, else 1 Hz).

    Barriers use it: an arrival is a state that the other members receive.
    """

    epoch: int
    hash: str
    """First eight digits of the mission's hash, or "" without a mission."""
    state: MissionPhase
    active: tuple[str, ...] = ()
    """Blocks that hold a token."""
    arrivals: tuple[Arrival, ...] = ()
    """Barriers at which the platform waits."""
    meetings: tuple[BarrierResult, ...] = ()
    """Newest barrier results that the platform knows."""
    progress_ratio: float = 0.0
    """Share of the mission's blocks that were entered, or the progress that the moving block reports."""
    text: str = ""
    """Text for operators."""
    mission: str = ""
    """Name of the played mission, or of the built-in mission that brings the vehicle to safety."""
    kind: PlatformKind = NO_KIND
    """Kind of the platform, for the assignment of roles."""
    drained_by: str = ""
    """Operator who drained the platform, which then takes no role in a new mission; else ""."""
    held_by: str = ""
    """Operator or pilot that drives the vehicle by hand, which holds its mission; else ""."""
    kept: tuple[int, ...] = ()
    """Epochs of the other runs that the platform keeps: they wait, or are suspended."""

    forms: ClassVar[tuple[Form, ...]] = (
        Form(
            "always",
            _HEAD_PARTS,
            "MessagePack array of active, arrivals, meetings, text, mission and, up to the last that is not"
            " empty, drained_by, held_by, kept",
        ),
    )

    def pack(self) -> bytes:
        """Encode the quantised form for the beacon."""
        head = _HEAD.pack(
            self.epoch,
            int(self.hash or "0", 16),
            PHASES.index(self.state),
            KINDS.index(self.kind),
            round(min(max(self.progress_ratio, 0.0), 1.0) * 255),
        )
        tail = (self.active, self.arrivals, self.meetings, self.text, self.mission)
        if self.kept:
            return head + _tail_encoder.encode(_KeptTail(*tail, self.drained_by, self.held_by, self.kept))
        if self.held_by:
            return head + _tail_encoder.encode(_HeldTail(*tail, self.drained_by, self.held_by))
        return head + _tail_encoder.encode(
            _DrainedTail(*tail, self.drained_by) if self.drained_by else _Tail(*tail)
        )

    @classmethod
    def unpack(cls, data: bytes | memoryview) -> Self:
        """Decode the quantised form.

        Raises: WireError for invalid bytes.
        """
        if len(data) < _HEAD.size:
            raise WireError(f"packed MissionState of {len(data)} bytes: expected {_HEAD.size} at least")
        epoch, digest, state, kind, ratio = _HEAD.unpack_from(data)
        if state >= len(PHASES) or kind >= len(KINDS):
            raise WireError(f"packed MissionState: state {state}, kind {kind}: expected known ones")
        try:
            tail = _tail_decoder.decode(data[_HEAD.size :])
        except (msgspec.DecodeError, ValueError) as error:
            raise WireError(f"packed MissionState: {error}") from error
        return cls(
            epoch,
            f"{digest:0{HASH_DIGITS}x}" if epoch else "",
            PHASES[state],
            tail.active,
            tail.arrivals,
            tail.meetings,
            ratio / 255,
            tail.text,
            tail.mission,
            KINDS[kind],
            tail.drained_by,
            tail.held_by,
            tail.kept,
        )


class _Tail(msgspec.Struct, frozen=True, array_like=True, gc=False):
    active: tuple[str, ...]
    arrivals: tuple[Arrival, ...]
    meetings: tuple[BarrierResult, ...]
    text: str
    mission: str


class _DrainedTail(_Tail, frozen=True, array_like=True, gc=False):
    drained_by: str = ""


class _HeldTail(_DrainedTail, frozen=True, array_like=True, gc=False):
    held_by: str = ""


class _KeptTail(_HeldTail, frozen=True, array_like=True, gc=False):
    kept: tuple[int, ...] = ()


_tail_encoder = msgspec.msgpack.Encoder()
_tail_decoder = msgspec.msgpack.Decoder(_KeptTail)


@register
class DrainOrder(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request to drain a platform, which then takes no role in a new mission, or to end that."""

    drained: bool


@register
class MissionProgress(msgspec.Struct, frozen=True):
    """One step of a mission (event `mission/progress`, logged)."""

    mission: str
    epoch: int
    block: str
    """Id of the block, or "" for the mission as a whole."""
    type: str
    """Type of the block; of the whole: Mission."""
    event: str
    """started | resumed | suspended | ok | timeout | error:<kind> | cancelled | abandoned | state:<state>."""
    at_ns: int
    """Instant on the own hardware clock."""
    text: str = ""


@register
class MissionStatus(msgspec.Struct, frozen=True):
    """State of a platform's mission for operators (`sys/mission/status`)."""

    platform: str
    state: MissionState
    role: str
    since_ns: int
    """Own hardware clock when the state was entered."""
    members: tuple[Member, ...] = ()
    others: dict[str, MissionState] = {}
    """States of the other members, as received here."""
    unmet: tuple[str, ...] = ()
    """Requirements that do not hold now."""
    ordered_by: str = ""
    """Authenticated sender of the order (`user@platform`), or "" without an order since the node's start."""
    reactions: tuple[ReactionState, ...] = ()
    """Rows of the platform's reactions to faults; empty at a ground station."""


@register
class StoredMission(msgspec.Struct, frozen=True):
    """A mission of the store."""

    name: str
    title: str
    hash: str
    roles: tuple[str, ...]
    sound: bool
    findings: int


@register
class MissionList(msgspec.Struct, frozen=True):
    """Answer of `sys/mission/ls`."""

    missions: tuple[StoredMission, ...]
