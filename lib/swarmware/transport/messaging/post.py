"""Message router: routes frames between applications of this process and node, and the gateway to others."""

import asyncio
from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from swarmware.errors import Denied, WireError, from_kind
from swarmware.model.clock import Clock
from swarmware.model.frame import HEADER_BYTES, PAYLOAD_LIMIT, Flag, Frame, FrameKind, decode, encode
from swarmware.model.names import ANY
from swarmware.runtime.driver import CoreDriver
from swarmware.transport.appfile.table import AppTable
from swarmware.transport.delivery.answer import answer, answerable, expired, expired_here, reply
from swarmware.transport.delivery.duplicates import DuplicateFilter, DuplicateState
from swarmware.transport.delivery.outbox import Action, Complete, Key, Outbox
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.transport.messaging.wire import Identity, Wire
from swarmware.types import registry
from swarmware.types.rpc import Ack, Reply
from swarmware.types.time import Conversion

BROKER: Final = "broker"
"""Application to which frames for other platforms go."""
WINDOW: Final = 256
"""Unanswered messages of one data id to one platform; more are refused to the sender at once."""
PROBE_NS: Final = 50_000_000
"""Least time between two searches for applications that died."""

MessageHandler = Callable[[Frame], Outcome | None]
"""Takes a message; None: no room now, let the sender try again."""
RequestHandler = Callable[[Frame, Callable[[Reply], None]], None]
"""Takes a request and, then or later, gives its answer to the function."""
Gateway = Callable[[Frame], None]
"""Takes frames for other platforms: the broker, when it is in this process."""
Together = Callable[[], AbstractContextManager[None]]
"""Holds frames back until all of them are there."""


class Clocks(Protocol):
    """Knows how the clocks of other hardware units read."""

    def conversion(self, hardware: int) -> Conversion | None:
        """The function of one unit's clock; None when it is not known."""
        ...


class _Served(NamedTuple):
    app_id: int
    message: MessageHandler | None
    request: RequestHandler | None


class Post:
    """Messages and requests of all applications of this process."""

    def __init__(
        self, *, platform: str, hardware: int, clock: Clock, socket_path: Path, table: AppTable
    ) -> None:
        self.platform = platform
        self.hardware = hardware
        self.counts: Counter[str] = Counter()
        """What happened: wire_errors, expired, unanswerable, no_answerer, answer_too_large."""
        self._clock = clock
        self._table = table
        self._table_version = table.version
        self._loop = asyncio.get_running_loop()
        self._wire = Wire(socket_path, self._on_data)
        self.endpoint = self._wire.endpoint
        self._gateway: Gateway | None = None
        self._together: Together = nullcontext
        self._served: dict[int, _Served] = {}
        self._apps: set[int] = set()
        self._clocks: dict[Clocks, None] = {}
        self._outbox = Outbox(hardware)
        self._received = DuplicateFilter()
        self._messages: dict[Key, asyncio.Future[Outcome]] = {}
        self._requests: dict[Key, asyncio.Future[Reply]] = {}
        self._windows: Counter[tuple[int, int]] = Counter()
        self._driver = CoreDriver(self._outbox, self._perform, name="post", clock=clock, loop=self._loop)
        self._probed_ns = 0
        self._closed = False

    # -- who is here

    def add_application(self, app_id: int) -> None:
        """An application of this process: answers to it are taken in."""
        self._apps.add(app_id)

    def remove_application(self, app_id: int) -> None:
        """The application has left: remove its handlers."""
        self._apps.discard(app_id)
        self._served = {data_id: one for data_id, one in self._served.items() if one.app_id != app_id}

    def serve_messages(self, data_id: int, app_id: int, handler: MessageHandler) -> None:
        """Messages of this data id go to the handler."""
        self._served[data_id] = _Served(app_id, handler, None)

    def serve_requests(self, data_id: int, app_id: int, handler: RequestHandler) -> None:
        """Requests of this data id go to the handler."""
        self._served[data_id] = _Served(app_id, None, handler)

    def unserve(self, data_id: int) -> None:
        """Remove the handler of this data id."""
        self._served.pop(data_id, None)

    def add_clocks(self, clocks: Clocks) -> None:
        """Where the clocks of other platforms are known: by them a message is expired."""
        self._clocks[clocks] = None

    def remove_clocks(self, clocks: Clocks) -> None:
        """Remove what `add_clocks` registered."""
        self._clocks.pop(clocks, None)

    def expired(self, frame: Frame) -> bool:
        """Whether the lifetime of a message is over, as far as the clock of its sender is known here."""
        now_ns = self._clock.now_ns()
        if frame.sender_hw == self.hardware:
            return expired(frame, now_ns)
        clocks = next(reversed(self._clocks), None)
        return clocks is not None and expired_here(frame, now_ns, clocks.conversion(frame.sender_hw))

    def set_gateway(self, gateway: Gateway | None, together: Together = nullcontext) -> None:
        """Frames for other platforms go to this function: called by the broker."""
        self._gateway = gateway
        self._together = together

    def together(self) -> AbstractContextManager[None]:
        """Frames for other platforms that are sent meanwhile leave at its end, as close as they can."""
        return self._together()

    # -- sending

    def send(self, frame: Frame, timeout_s: float) -> asyncio.Future[Outcome]:
        """Send a message; the future has its outcome and never fails."""
        future: asyncio.Future[Outcome] = self._loop.create_future()
        window = (frame.receiver_hw, frame.data_id)
        if self._windows[window] >= WINDOW:
            future.set_result(Outcome(Status.REFUSED, self.platform, f"{WINDOW} messages wait for an answer"))
            return future
        self._windows[window] += 1
        key = Outbox.key(frame)
        self._messages[key] = future
        future.add_done_callback(partial(self._message_done, key, window))
        self._submit(frame, timeout_s)
        return future

    def request(self, frame: Frame, timeout_s: float) -> asyncio.Future[Reply]:
        """A request; the future has the reply, or a NoAnswer or NotFound that says where it stopped."""
        future: asyncio.Future[Reply] = self._loop.create_future()
        key = Outbox.key(frame)
        self._requests[key] = future
        future.add_done_callback(partial(self._request_done, key))
        self._submit(frame, timeout_s)
        return future

    def deliver(self, frame: Frame) -> None:
        """A frame that came from another platform: called by the broker."""
        self._route(frame, None)

    def refuse(self, frame: Frame, status: Status, detail: str) -> None:
        """Report to the sender of a message or request why it is not forwarded; called by any hop."""
        self._answer(frame, status, detail, None)

    def deny(self, frame: Frame, reason: str) -> None:
        """Report to the sender that it has no permission; called by the broker."""
        if frame.kind is FrameKind.REQUEST:
            payload = registry.encode(Reply(False, kind=Denied.__name__, error=reason))
            self._give_back(frame, FrameKind.REPLY, payload, None)
        else:
            self._answer(frame, Status.REFUSED, reason, None)

    # -- own messages and requests

    def _submit(self, frame: Frame, timeout_s: float) -> None:
        now_ns = self._clock.now_ns()
        self._driver.feed(self._outbox.on_submit(frame, round(timeout_s * 1e9), now_ns))

    def _message_done(self, key: Key, window: tuple[int, int], _: asyncio.Future[Outcome]) -> None:
        self._messages.pop(key, None)
        self._outbox.drop(key)
        self._windows[window] -= 1
        if not self._windows[window]:
            del self._windows[window]

    def _request_done(self, key: Key, _: asyncio.Future[Reply]) -> None:
        self._requests.pop(key, None)
        self._outbox.drop(key)

    def _perform(self, action: Action) -> None:
        if isinstance(action, Complete):
            self._settle(action.key, action.outcome)
            return
        if action.retransmission:
            self._probe()
        self._route(action.frame, None)

    def _settle(self, key: Key, outcome: Outcome) -> None:
        message = self._messages.get(key)
        if message is not None and not message.done():
            message.set_result(outcome)
            return
        request = self._requests.get(key)
        if request is not None and not request.done():
            kind = "NotFound" if outcome.status is Status.REFUSED else "NoAnswer"
            request.set_exception(from_kind(kind, str(outcome)))

    def _probe(self) -> None:
        now_ns = self._clock.now_ns()
        if now_ns - self._probed_ns >= PROBE_NS:
            self._probed_ns = now_ns
            self._refresh(probe=True)

    def _refresh(self, *, probe: bool = False) -> None:
        self._table.refresh(probe=probe)
        if self._table.version != self._table_version:
            self._table_version = self._table.version
            self._wire.keep_only({entry.endpoint for entry in self._table})

    # -- routing

    def _on_data(self, data: bytes, identity: Identity | None) -> None:
        try:
            frame = decode(data)
        except WireError:
            self.counts["wire_errors"] += 1
            return
        self._route(frame, identity)

    def _route(self, frame: Frame, via: Identity | None) -> None:
        if self._closed:
            return
        if frame.receiver_hw not in {self.hardware, ANY}:
            self._route_away(frame, via)
        elif frame.kind in {FrameKind.ACK, FrameKind.REPLY}:
            self._route_answer(frame)
        elif answerable(frame):
            self._route_question(frame, via)
        else:
            self.counts["unanswerable"] += 1  # nothing of ours is sent without wanting an answer

    def _route_away(self, frame: Frame, via: Identity | None) -> None:
        if self._gateway is not None:
            self._gateway(frame)
            return
        self._refresh()
        broker = self._table.named(BROKER)
        if broker is not None and broker.endpoint != self.endpoint:
            self._write(broker.endpoint, frame)
        elif answerable(frame):
            self._answer(frame, Status.UNREACHABLE, "no broker runs here", via)

    def _route_answer(self, frame: Frame) -> None:
        if frame.receiver_app in self._apps:
            self._on_answer(frame)
            return
        self._refresh()
        entry = self._table.application(frame.receiver_app)
        if entry is not None and entry.endpoint != self.endpoint:
            self._write(entry.endpoint, frame)
        else:
            self.counts["no_answerer"] += 1  # the asker left before the answer came

    def _route_question(self, frame: Frame, via: Identity | None) -> None:
        served = self._served.get(frame.data_id)
        if served is not None and frame.receiver_app in {ANY, served.app_id}:
            # in a turn of its own: a sender never runs the receiver's code
            self._loop.call_soon(self._arrived, frame, via)
            return
        self._refresh()
        if frame.receiver_app == ANY:
            entry = self._table.serving(frame.data_id)
        else:
            entry = self._table.application(frame.receiver_app)
        if entry is not None and entry.endpoint != self.endpoint:
            self._write(entry.endpoint, frame)
            if frame.sender_hw == self.hardware:
                self._outbox.reached(Outbox.key(frame))
        else:
            self._answer(frame, Status.ABSENT, "no application here takes this path and type", via)

    def _write(self, endpoint: str, frame: Frame) -> None:
        self._wire.send(endpoint, encode(frame), urgent=bool(frame.flags & Flag.URGENT))

    # -- questions that came to an application of this process

    def _arrived(self, frame: Frame, via: Identity | None) -> None:
        if self._closed:
            return
        served = self._served.get(frame.data_id)
        if served is None:
            self._answer(frame, Status.ABSENT, "the inbox was closed", via)
            return
        origin = (frame.sender_hw, frame.sender_app, frame.data_id, frame.sequence)
        seen = self._received.lookup(origin)
        if seen is not None:
            self._answer_again(frame, seen, via)
        elif self.expired(frame):
            self.counts["expired"] += 1  # its sender has got an outcome, so it must not be delivered any more
        elif frame.kind is not FrameKind.REQUEST and served.message is not None:
            outcome = served.message(frame)
            if outcome is not None:
                payload = registry.encode(
                    Ack(int(outcome.status), outcome.where, outcome.detail, outcome.received_ns)
                )
                if outcome.delivered:  # one that is refused is refused again if it comes again
                    self._received.answered(origin, payload, self._clock.now_ns())
                self._give_back(frame, FrameKind.ACK, payload, via)
        elif frame.kind is FrameKind.REQUEST and served.request is not None:
            self._received.begin(origin, self._clock.now_ns())
            served.request(frame, partial(self._replied, frame, via))
        else:
            takes = "messages" if served.message is not None else "requests"
            self._answer(frame, Status.REFUSED, f"this path takes {takes} only", via)

    def _answer_again(self, frame: Frame, seen: bytes | DuplicateState, via: Identity | None) -> None:
        if isinstance(seen, bytes):
            self._give_back(
                frame, FrameKind.REPLY if frame.kind is FrameKind.REQUEST else FrameKind.ACK, seen, via
            )
        elif seen is DuplicateState.IN_WORK or frame.kind is not FrameKind.REQUEST:
            self._answer(frame, Status.DELIVERED, "", via)
        else:
            self._replied(frame, via, Reply(False, kind="NoAnswer", error="the answer is no longer held"))

    def _replied(self, frame: Frame, via: Identity | None, answer_: Reply) -> None:
        payload = registry.encode(answer_)
        if len(payload) > PAYLOAD_LIMIT - HEADER_BYTES:
            self.counts["answer_too_large"] += 1
            payload = registry.encode(
                Reply(False, kind="OutOfRange", error=f"answer of {len(payload)} bytes: too large")
            )
        origin = (frame.sender_hw, frame.sender_app, frame.data_id, frame.sequence)
        self._received.answered(origin, payload, self._clock.now_ns())
        self._give_back(frame, FrameKind.REPLY, payload, via)

    def _answer(self, frame: Frame, status: Status, detail: str, via: Identity | None) -> None:
        now_ns = self._clock.now_ns()
        self._send_back(answer(frame, status, where=self.platform, detail=detail, stamp_ns=now_ns), via)

    def _give_back(self, frame: Frame, kind: FrameKind, payload: bytes, via: Identity | None) -> None:
        back = reply(frame, kind, payload, self._clock.now_ns())
        back.sender_hw = self.hardware
        self._send_back(back, via)

    def _send_back(self, back: Frame, via: Identity | None) -> None:
        if via is None or not self._wire.send_back(via, encode(back)):
            self._route(back, None)

    # -- answers to questions of this process

    def _on_answer(self, frame: Frame) -> None:
        key = (frame.receiver_app, frame.data_id, frame.sequence)
        now_ns = self._clock.now_ns()
        try:
            if frame.kind is FrameKind.ACK:
                ack = registry.decode(Ack, frame.payload, frame.codec)
                self._driver.feed(self._outbox.on_ack(key, ack, now_ns))
                return
            answer_ = registry.decode(Reply, frame.payload, frame.codec)
        except WireError:
            self.counts["wire_errors"] += 1
            return
        future = self._requests.get(key)
        self._driver.feed(self._outbox.on_reply(key, now_ns))
        if future is not None and not future.done():  # else it is a duplicate
            future.set_result(answer_)

    def close(self) -> None:
        """Close the sockets; pending requests get the error that this application ends."""
        self._closed = True
        self._driver.stop()
        gone = Outcome(Status.UNREACHABLE, self.platform, "this application ends")
        for key in [*self._messages, *self._requests]:
            self._settle(key, gone)
        self._wire.close()
