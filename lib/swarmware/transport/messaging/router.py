"""Routing of the frames of a process: to a local handler, another process, the gateway, or back to the
sender.

Sans-io: time is an argument, and events report the applications of the node.
"""

from collections.abc import Callable, Hashable, Iterable, Mapping
from enum import Enum
from typing import Final

import msgspec

from swarmware.errors import Denied, WireError
from swarmware.model.frame import HEADER_BYTES, PAYLOAD_LIMIT, Frame, FrameKind
from swarmware.model.names import ANY
from swarmware.transport.delivery import outbox
from swarmware.transport.delivery.answer import ANSWERS, answer, answerable, expired, expired_here, reply
from swarmware.transport.delivery.duplicates import DuplicateFilter, DuplicateState
from swarmware.transport.delivery.outbox import Complete, Key, Outbox
from swarmware.transport.delivery.outcome import ABSENT, FULL, Outcome, Status
from swarmware.types import registry
from swarmware.types.rpc import Ack, Reply
from swarmware.types.system import MessageCounters
from swarmware.types.time import Conversion

PROBE_NS: Final = 50_000_000
"""Minimum time between two searches for applications that died."""

Via = Hashable
"""The connection from which a frame came, over which its answer returns, or None for this process or another
node."""


class Takes(Enum):
    """Kinds of frames that an application takes at an address."""

    MESSAGES = "messages"
    REQUESTS = "requests"
    DATAGRAMS = "datagrams"


class Deliver(msgspec.Struct, frozen=True, gc=False):
    """Deliver the frame to the handler of its data id in this process."""

    frame: Frame


class Settle(msgspec.Struct, frozen=True, gc=False):
    """The frame is an answer to a message or request of this process."""

    frame: Frame


class ToProcess(msgspec.Struct, frozen=True, gc=False):
    """Send the frame to the process at this address."""

    address: str
    frame: Frame


class ToGateway(msgspec.Struct, frozen=True, gc=False):
    """Pass the frame for another platform to the gateway, which is in this process."""

    frame: Frame


class Refuse(msgspec.Struct, frozen=True, gc=False):
    """The frame cannot be forwarded; its sender gets the reason."""

    frame: Frame
    status: Status
    detail: str


class Drop(msgspec.Struct, frozen=True, gc=False):
    """The frame cannot be forwarded, and its sender does not wait for an answer."""

    counter: str
    """Name of the field of `MessageCounters` to be incremented."""


Decision = Deliver | Settle | ToProcess | ToGateway | Refuse | Drop


class Arrive(msgspec.Struct, frozen=True, gc=False):
    """Call `on_arrival` in the next iteration of the event loop: a sender never runs the code of the
    receiver."""

    frame: Frame


class HandOver(msgspec.Struct, frozen=True, gc=False):
    """Call the handler with the frame; then `on_outcome` or `on_handler_reply`."""

    frame: Frame
    via: Via
    takes: Takes


class SendBack(msgspec.Struct, frozen=True, gc=False):
    """Send an answer over this connection; if it has closed, call `on_connection_closed`."""

    via: Via
    frame: Frame


class Replied(msgspec.Struct, frozen=True, gc=False):
    """A request of this process got its reply."""

    key: Key
    reply: Reply


class Probe(msgspec.Struct, frozen=True, gc=False):
    """Check for applications that died, and report a change by `on_applications`."""


class Repeat(msgspec.Struct, frozen=True, gc=False):
    """Call `on_repeat`, after the result of the preceding `Probe`."""

    frame: Frame


class KeepConnections(msgspec.Struct, frozen=True, gc=False):
    """Close the connections to all other addresses, because their processes have left."""

    addresses: frozenset[str]


Action = (
    Arrive
    | HandOver
    | ToProcess
    | ToGateway
    | SendBack
    | Complete
    | Replied
    | Probe
    | Repeat
    | KeepConnections
)


class _Served(msgspec.Struct, frozen=True):
    app_id: int
    takes: Takes


class MessageRouter:
    """Routes messages and requests of all applications of one process, and their answers."""

    def __init__(
        self,
        *,
        platform: str,
        hardware: int,
        address: str,
        conversion: Callable[[int], Conversion | None] = lambda hardware: None,
    ) -> None:
        """`conversion`: returns the clock function of another hardware unit, to detect its expired
        messages."""
        self.has_gateway = False
        self._counters = MessageCounters()
        self._platform = platform
        self._hardware = hardware
        self._address = address
        self._conversion = conversion
        self._served: dict[int, _Served] = {}
        self._own_apps: set[int] = set()
        self._by_application: Mapping[int, str] = {}
        self._by_data_id: Mapping[int, str] = {}
        self._broker: str | None = None
        self._outbox = Outbox(hardware, platform)
        self._received = DuplicateFilter()
        self._probed_ns = -PROBE_NS

    def counters(self) -> MessageCounters:
        """Counters since the start of frames that were not delivered, or were sent or received more than
        once."""
        return msgspec.structs.replace(
            self._counters, repeated=self._outbox.resent, duplicates=self._received.duplicates
        )

    # -- applications

    def add_application(self, app_id: int) -> None:
        """Register an application of this process, so that answers to it are accepted."""
        self._own_apps.add(app_id)

    def remove_application(self, app_id: int) -> list[int]:
        """Remove an application; returns the data ids that it served."""
        self._own_apps.discard(app_id)
        removed = [data_id for data_id, one in self._served.items() if one.app_id == app_id]
        for data_id in removed:
            del self._served[data_id]
        return removed

    def serve(self, data_id: int, app_id: int, takes: Takes) -> None:
        """Register a data id that an application of this process serves."""
        self._served[data_id] = _Served(app_id, takes)

    def on_applications(
        self,
        by_application: Mapping[int, str],
        by_data_id: Mapping[int, str],
        broker: str | None,
        now_ns: int,
    ) -> list[Action]:
        """The applications of the node have changed: addresses by application id, and by served data id."""
        self._by_application = by_application
        self._by_data_id = by_data_id
        self._broker = broker
        return [KeepConnections(frozenset(by_application.values()))]

    # -- the decision

    def needs_applications(self, frame: Frame) -> bool:
        """Whether the route of the frame depends on the present applications of other processes."""
        if frame.receiver_hw not in (self._hardware, ANY):
            return not self.has_gateway
        if frame.kind in ANSWERS:
            return frame.receiver_app not in self._own_apps
        served = self._served.get(frame.data_id)
        return served is None or frame.receiver_app not in (ANY, served.app_id)

    def is_for_gateway(self, frame: Frame) -> bool:
        """Whether the route of the frame is `ToGateway`."""
        return self.has_gateway and frame.receiver_hw not in (self._hardware, ANY)

    def leaves_node(self, frame: Frame) -> bool:
        """Whether the receiver of the frame is another node."""
        return frame.receiver_hw not in (self._hardware, ANY)

    def is_own(self, frame: Frame) -> bool:
        """Whether the sender of the frame belongs to this node."""
        return frame.sender_hw == self._hardware

    def is_served(self, frame: Frame) -> bool:
        """Whether the route of the frame is `Deliver`."""
        served = self._served.get(frame.data_id)
        return (
            served is not None
            and frame.receiver_app in (ANY, served.app_id)
            and frame.receiver_hw in (self._hardware, ANY)
            and answerable(frame)
        )

    def route(self, frame: Frame) -> Decision:
        """Decide the route of a frame, without changing the state of the router."""
        if frame.receiver_hw not in (self._hardware, ANY):
            return self._route_away(frame)
        if frame.kind in ANSWERS:
            if frame.receiver_app in self._own_apps:
                return Settle(frame)
            return self._to_process(frame) or Drop("unclaimed_answers")  # the receiver left before the answer
        if not answerable(frame) and frame.kind is not FrameKind.RTP:
            return Drop("unanswerable")  # every other frame of this process requests an answer
        served = self._served.get(frame.data_id)
        if served is not None and frame.receiver_app in (ANY, served.app_id):
            return Deliver(frame)
        absent = Drop("unclaimed_datagrams") if frame.kind is FrameKind.RTP else None
        return self._to_process(frame) or absent or Refuse(frame, Status.ABSENT, ABSENT)

    def _route_away(self, frame: Frame) -> Decision:
        if self.has_gateway:
            return ToGateway(frame)
        if answerable(frame):
            return self._to_process(frame) or Refuse(frame, Status.UNREACHABLE, "no broker runs here")
        return self._to_process(frame) or Drop("unclaimed_answers")

    def process_of(self, frame: Frame) -> str | None:
        """Address of the process that takes a frame instead of this one, as far as it is known now."""
        if frame.receiver_hw not in (self._hardware, ANY):
            return self._broker
        if frame.receiver_app == ANY and frame.kind not in ANSWERS:
            return self._by_data_id.get(frame.data_id)
        return self._by_application.get(frame.receiver_app)

    def _to_process(self, frame: Frame) -> ToProcess | None:
        address = self.process_of(frame)  # own address: this process does not serve it
        return None if address is None or address == self._address else ToProcess(address, frame)

    # -- own messages and requests

    def on_message(self, frame: Frame, timeout_ns: int, now_ns: int) -> list[Action]:
        """An application of this process sends a message; the last action for it is a Complete."""
        (action,) = self._outbox.on_submit(frame, timeout_ns, now_ns)
        return [action] if isinstance(action, Complete) else self._send(frame, now_ns)

    def on_request(self, frame: Frame, timeout_ns: int, now_ns: int) -> list[Action]:
        """An application of this process sends a request; its last action is a Replied or a Complete."""
        self._outbox.on_submit(frame, timeout_ns, now_ns)  # its one action is to transmit
        return self._send(frame, now_ns)

    def cancel(self, key: Key) -> None:
        """Remove a message or request whose sender does not wait any longer."""
        self._outbox.drop(key)

    def on_timer(self, now_ns: int) -> list[Action]:
        """Return retransmissions and time-outs that are due."""
        return self._own(self._outbox.on_timer(now_ns), now_ns)

    def deadline_ns(self) -> int | None:
        """Instant at which `on_timer` must be called, or None without a deadline."""
        return self._outbox.deadline_ns()

    def on_repeat(self, frame: Frame, now_ns: int) -> list[Action]:
        """Retransmit a frame of this process, with the present applications."""
        return self._send(frame, now_ns)

    def _own(self, actions: Iterable[outbox.Action], now_ns: int) -> list[Action]:
        out: list[Action] = []
        for action in actions:
            if isinstance(action, Complete):
                out.append(action)
            else:
                # The receiver may have died; each check costs a lock for every application.
                if now_ns - self._probed_ns >= PROBE_NS:
                    self._probed_ns = now_ns
                    out.append(Probe())
                out.append(Repeat(action.frame))
        return out

    def _send(self, frame: Frame, now_ns: int) -> list[Action]:
        decision = self.route(frame)
        if isinstance(decision, ToProcess):
            if frame.receiver_hw in (self._hardware, ANY):
                self._outbox.reached(Outbox.key(frame))
            return [decision]
        if isinstance(decision, Deliver):
            return [Arrive(frame)]
        return self._carry_on(decision, None, now_ns)

    # -- frames of others

    def on_frame(self, frame: Frame, via: Via, now_ns: int) -> list[Action]:
        """A frame arrived from another process over the connection `via`, or from the gateway."""
        decision = self.route(frame)
        if not isinstance(decision, Deliver):
            return self._carry_on(decision, via, now_ns)
        if via is None:
            return [Arrive(frame)]
        return self.on_arrival(frame, via, now_ns)

    def on_connection_closed(self, back: Frame, now_ns: int) -> list[Action]:
        """The connection for this answer has closed: route it by the table of applications."""
        return self._carry_on(self.route(back), None, now_ns)

    def on_refusal(self, frame: Frame, refusal: tuple[Status, str], via: Via, now_ns: int) -> list[Action]:
        """A message or request is refused before it is routed; its sender gets the reason."""
        return self._carry_on(Refuse(frame, *refusal), via, now_ns)

    def on_denial(self, frame: Frame, reason: str, via: Via, now_ns: int) -> list[Action]:
        """A message or request is denied, because its sender does not have the required role."""
        if frame.kind is not FrameKind.REQUEST:
            return self._carry_on(Refuse(frame, Status.REFUSED, reason), via, now_ns)
        denied = registry.encode(Reply(False, kind=Denied.__name__, error=reason))
        return self._give_back(frame, FrameKind.REPLY, denied, via, now_ns)

    def _carry_on(self, decision: Decision, via: Via, now_ns: int) -> list[Action]:
        """The actions for a frame that is not delivered in this process.

        The answer to a refused frame is routed in the same call; an answer is never refused.
        """
        if isinstance(decision, Refuse):
            refused = decision.frame
            back = answer(
                refused, decision.status, where=self._platform, detail=decision.detail, stamp_ns=now_ns
            )
            if via is not None:
                return [SendBack(via, back)]
            decision = self.route(back)
        match decision:
            case ToProcess() | ToGateway():
                return [decision]
            case Settle(frame):
                return self._settle(frame, now_ns)
            case Drop(counter):
                setattr(self._counters, counter, getattr(self._counters, counter) + 1)
        return []

    def count_malformed(self) -> None:
        """Count bytes of another process that are not a frame."""
        self._counters.malformed += 1

    def _settle(self, frame: Frame, now_ns: int) -> list[Action]:
        key = (frame.receiver_app, frame.data_id, frame.sequence)
        try:
            if frame.kind is FrameKind.ACK:
                ack = registry.decode(Ack, frame.payload, frame.codec)
                return self._own(self._outbox.on_ack(key, ack, now_ns), now_ns)
            replied = registry.decode(Reply, frame.payload, frame.codec)
        except WireError:
            self._counters.malformed += 1
            return []
        self._outbox.answered(key, now_ns)
        return [Replied(key, replied)]

    # -- messages and requests to an application of this process

    def on_arrival(self, frame: Frame, via: Via, now_ns: int) -> list[Action]:
        """A message or request for a handler of this process has arrived."""
        served = self._served.get(frame.data_id)
        if frame.kind is FrameKind.RTP:  # no answer is awaited, and no right was checked: datagrams only
            takes_it = served is not None and served.takes is Takes.DATAGRAMS
            return [HandOver(frame, via, Takes.DATAGRAMS)] if takes_it else []
        if served is None:
            return self._refuse(frame, Status.ABSENT, "the inbox was closed", via, now_ns)
        origin = _origin(frame)
        seen = self._received.lookup(origin)
        if seen is not None:
            return self._answer_duplicate(frame, seen, via, now_ns)
        if self.expired(frame, now_ns):
            self._counters.expired += 1  # its sender has the outcome `expired` already: no delivery
            return []
        if served.takes is not (Takes.REQUESTS if frame.kind is FrameKind.REQUEST else Takes.MESSAGES):
            detail = f"this path takes {served.takes.value} only"
            return self._refuse(frame, Status.REFUSED, detail, via, now_ns)
        if served.takes is Takes.REQUESTS:
            # Before the handler runs: a retransmission meanwhile must not start it a second time.
            self._received.begin(origin, now_ns)
        return [HandOver(frame, via, served.takes)]

    def expired(self, frame: Frame, now_ns: int) -> bool:
        """Whether the lifetime of a message is over; false while the clock of its sender is not known
        here."""
        if frame.sender_hw == self._hardware:
            return expired(frame, now_ns)
        return expired_here(frame, now_ns, self._conversion(frame.sender_hw))

    def _answer_duplicate(
        self, frame: Frame, seen: bytes | DuplicateState, via: Via, now_ns: int
    ) -> list[Action]:
        if isinstance(seen, bytes):
            kind = FrameKind.REPLY if frame.kind is FrameKind.REQUEST else FrameKind.ACK
            return self._give_back(frame, kind, seen, via, now_ns)
        if seen is DuplicateState.IN_WORK or frame.kind is not FrameKind.REQUEST:
            return self._refuse(frame, Status.DELIVERED, "", via, now_ns)
        lost = Reply(False, kind="NoAnswer", error="the answer is no longer held")
        return self.on_handler_reply(frame, via, lost, now_ns)

    def on_outcome(self, frame: Frame, via: Via, outcome: Outcome | None, now_ns: int) -> list[Action]:
        """Take the handler's outcome of a message, or None with a full inbox: the sender then retransmits."""
        if outcome is None:
            self._counters.no_room += 1
            return self._refuse(frame, Status.UNREACHABLE, FULL, via, now_ns)
        payload = registry.encode(
            Ack(int(outcome.status), outcome.where, outcome.detail, outcome.received_ns)
        )
        if outcome.delivered:  # a refused message is not stored: a retransmission is refused again
            self._received.answered(_origin(frame), payload, now_ns)
        return self._give_back(frame, FrameKind.ACK, payload, via, now_ns)

    def on_handler_reply(self, frame: Frame, via: Via, replied: Reply, now_ns: int) -> list[Action]:
        """A handler has returned the reply to a request."""
        payload = registry.encode(replied)
        if len(payload) > PAYLOAD_LIMIT - HEADER_BYTES:
            self._counters.oversized_answers += 1
            payload = registry.encode(
                Reply(False, kind="OutOfRange", error=f"answer of {len(payload)} bytes: too large")
            )
        self._received.answered(_origin(frame), payload, now_ns)
        return self._give_back(frame, FrameKind.REPLY, payload, via, now_ns)

    def _refuse(self, frame: Frame, status: Status, detail: str, via: Via, now_ns: int) -> list[Action]:
        return self._carry_on(Refuse(frame, status, detail), via, now_ns)

    def _give_back(
        self, frame: Frame, kind: FrameKind, payload: bytes, via: Via, now_ns: int
    ) -> list[Action]:
        back = reply(frame, kind, payload, now_ns)
        back.sender_hw = self._hardware
        return [SendBack(via, back)] if via is not None else self._carry_on(self.route(back), None, now_ns)


def _origin(frame: Frame) -> tuple[int, int, int, int]:
    return frame.sender_hw, frame.sender_app, frame.data_id, frame.sequence
