"""The messages and requests of a process: futures, handlers and sockets around the message router."""

import asyncio
import logging
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import Final, Protocol

from swarmware.errors import Denied, WireError, from_kind
from swarmware.model.clock import Clock
from swarmware.model.frame import Frame, decode, encode
from swarmware.runtime.driver import CoreDriver
from swarmware.transport.appfile.table import AppTable
from swarmware.transport.delivery.answer import ANSWERS, answerable
from swarmware.transport.delivery.large_requests import LargeRequests
from swarmware.transport.delivery.outbox import Complete, Key, Outbox
from swarmware.transport.delivery.outcome import ABSENT, Outcome, Status
from swarmware.transport.delivery.parts import PartAssembly
from swarmware.transport.delivery.sender import Caller, with_caller, with_sender
from swarmware.transport.messaging.callers import Callers
from swarmware.transport.messaging.ipc_transport import IpcConnection, IpcTransport
from swarmware.transport.messaging.router import (
    Action,
    Arrive,
    HandOver,
    KeepConnections,
    MessageRouter,
    Probe,
    Repeat,
    Replied,
    SendBack,
    Takes,
    ToGateway,
    ToProcess,
    Via,
)
from swarmware.types.rpc import Reply
from swarmware.types.system import MessageCounters
from swarmware.types.time import Conversion

BROKER: Final = "broker"
"""Application to which frames for other platforms go."""
CONVERSION_NS: Final = 100_000_000
"""Time for which the clock function of another unit is cached, in ns; it changes once a second."""

MessageHandler = Callable[[Frame], Outcome | None]
"""Takes a message and returns its outcome, or None with a full inbox, so that the sender retransmits."""
RequestHandler = Callable[[Frame, Callable[[Reply], None]], None]
"""Takes a request; calls the function with the reply, at once or later."""
Gateway = Callable[[Frame], None]
"""Function of the broker that takes frames for other platforms, if the broker is in this process."""
Relay = Callable[[Frame, bytes | None], None]
"""Takes such a frame of another process of this node, decoded and as received bytes, or None if changed."""
Batch = Callable[[], AbstractContextManager[None]]
"""Context manager that queues frames for other platforms and sends them when it ends."""


log = logging.getLogger("swarm.messages")


class Clocks(Protocol):
    """Clock functions of other hardware units."""

    def conversion(self, hardware: int) -> Conversion | None:
        """The function of one unit's clock, or None if it is unknown."""
        ...


class MessageEndpoint:
    """Sends and receives the messages and requests of all applications of this process."""

    def __init__(
        self,
        *,
        platform: str,
        hardware: int,
        clock: Clock,
        socket_path: Path,
        table: AppTable,
        callers: Callers | None = None,
    ) -> None:
        """`callers`: roles of users, or None if all processes that can connect have the platform's rights.

        Raises: InvalidInput when the socket's path is too long.
        """
        self._callers = callers
        self._platform = platform
        self._clock = clock
        self._table = table
        self._table_version: int | None = None
        self._loop = asyncio.get_running_loop()
        self._transport = IpcTransport(socket_path, self._on_data, self._on_malformed)
        self.address = self._transport.address
        """Address of this process for other processes of the node: `ipc://<path of the socket>`."""
        self._gateway: Gateway | None = None
        self._relay: Relay | None = None
        self._batch: Batch = nullcontext
        self._message_handlers: dict[int, MessageHandler] = {}
        self._request_handlers: dict[int, RequestHandler] = {}
        self._datagram_handlers: dict[int, Callable[[Frame], None]] = {}
        self._clocks: dict[Clocks, None] = {}
        self._conversions: dict[int, Conversion | None] = {}
        self._conversions_ns = 0
        self._messages: dict[Key, asyncio.Future[Outcome]] = {}
        self._requests: dict[Key, asyncio.Future[Reply]] = {}
        self._parts = PartAssembly(platform)
        self._large = LargeRequests(self._parts)
        self._router = MessageRouter(
            platform=platform, hardware=hardware, address=self.address, conversion=self._conversion
        )
        self._driver = CoreDriver(self._router, self._perform, name="messages", clock=clock, loop=self._loop)

    # -- applications of this process

    def add_application(self, app_id: int) -> None:
        """Register an application of this process, so that answers to it are accepted."""
        self._router.add_application(app_id)

    def remove_application(self, app_id: int) -> None:
        """Remove an application that has left, with the addresses that it served."""
        for data_id in self._router.remove_application(app_id):
            self._message_handlers.pop(data_id, None)
            self._request_handlers.pop(data_id, None)
            self._datagram_handlers.pop(data_id, None)

    def serve_messages(self, data_id: int, app_id: int, handler: MessageHandler) -> None:
        """Register the handler of messages with this data id."""
        self._message_handlers[data_id] = handler
        self._router.serve(data_id, app_id, Takes.MESSAGES)

    def serve_requests(self, data_id: int, app_id: int, handler: RequestHandler) -> None:
        """Register the handler of requests with this data id."""
        self._request_handlers[data_id] = handler
        self._router.serve(data_id, app_id, Takes.REQUESTS)

    def serve_datagrams(self, data_id: int, app_id: int, handler: Callable[[Frame], None]) -> None:
        """Register the handler of datagrams of video with this data id; no right of their sender is
        checked."""
        self._datagram_handlers[data_id] = handler
        self._router.serve(data_id, app_id, Takes.DATAGRAMS)

    def add_clocks(self, clocks: Clocks) -> None:
        """Add a source of clock functions, which are needed to detect expired messages of other platforms."""
        self._clocks[clocks] = None
        self._conversions.clear()

    def remove_clocks(self, clocks: Clocks) -> None:
        """Remove a source that `add_clocks` added."""
        self._clocks.pop(clocks, None)
        self._conversions.clear()

    def _conversion(self, hardware: int) -> Conversion | None:
        now_ns = self._clock.now_ns()
        if now_ns - self._conversions_ns > CONVERSION_NS:
            self._conversions_ns = now_ns
            self._conversions.clear()
        elif hardware in self._conversions:
            return self._conversions[hardware]
        # the newest source: the oldest may belong to a module that is leaving
        clocks = next(reversed(self._clocks), None)
        conversion = None if clocks is None else clocks.conversion(hardware)
        self._conversions[hardware] = conversion
        return conversion

    def counters(self) -> MessageCounters:
        """Counters of frames that were not delivered, and of those sent or received more than once."""
        counters = self._router.counters()
        counters.dropped = self._transport.dropped
        counters.denied = 0 if self._callers is None else self._callers.denied
        return counters

    # -- sending

    def send(self, frame: Frame, timeout_s: float) -> asyncio.Future[Outcome]:
        """Send a message; the future gets its outcome, never an exception."""
        future: asyncio.Future[Outcome] = self._loop.create_future()
        key = Outbox.key(frame)
        self._messages[key] = future
        # also when its caller is cancelled: the router must not repeat the message then
        future.add_done_callback(partial(self._message_done, key))
        self._refresh_for(frame)
        now_ns = self._clock.now_ns()
        self._driver.feed(self._router.on_message(frame, round(timeout_s * 1e9), now_ns))
        return future

    def request(self, frame: Frame, timeout_s: float) -> asyncio.Future[Reply]:
        """Send a request; the future gets the reply, or NoAnswer or NotFound with the hop at which it
        stopped."""
        future: asyncio.Future[Reply] = self._loop.create_future()
        key = Outbox.key(frame)
        self._requests[key] = future
        future.add_done_callback(partial(self._request_done, key))
        self._refresh_for(frame)
        now_ns = self._clock.now_ns()
        self._driver.feed(self._router.on_request(frame, round(timeout_s * 1e9), now_ns))
        return future

    def post(self, frame: Frame) -> None:
        """Send a datagram of video: once, without an outcome."""
        self._refresh_for(frame)
        self._driver.feed(self._router.on_frame(frame, None, self._clock.now_ns()))

    def _message_done(self, key: Key, future: asyncio.Future[Outcome]) -> None:
        if self._messages.get(key) is future:
            del self._messages[key]
            self._router.cancel(key)

    def _request_done(self, key: Key, future: asyncio.Future[Reply]) -> None:
        if self._requests.get(key) is future:
            del self._requests[key]
            self._router.cancel(key)

    # -- the gateway: called by the broker

    def set_gateway(
        self, gateway: Gateway | None, batch: Batch = nullcontext, *, relay: Relay | None = None
    ) -> None:
        """Set the function for frames to other platforms; `relay` takes the ones from other processes."""
        self._gateway = gateway
        self._relay = relay
        self._batch = batch
        self._router.has_gateway = gateway is not None

    def batch(self) -> AbstractContextManager[None]:
        """Context manager: frames for other platforms are sent together when it ends, with minimum delay
        between them."""
        return self._batch()

    def deliver(self, frame: Frame) -> None:
        """Deliver a frame from another platform."""
        self._refresh_for(frame)
        decision = self._router.route(frame)
        if isinstance(decision, ToProcess):  # a passing frame does not change the router
            self._transport.send(decision.address, encode(frame), urgent=frame.is_urgent)
        else:
            self._driver.feed(self._router.on_frame(frame, None, self._clock.now_ns()))

    def refuse(self, frame: Frame, status: Status, detail: str) -> None:
        """Refuse a message or request that cannot be forwarded; its sender gets the reason."""
        self._refresh()
        self._driver.feed(self._router.on_refusal(frame, (status, detail), None, self._clock.now_ns()))

    def deny(self, frame: Frame, reason: str) -> None:
        """Deny a message or request whose sender does not have the required role."""
        self._refresh()
        self._driver.feed(self._router.on_denial(frame, reason, None, self._clock.now_ns()))

    def expired(self, frame: Frame) -> bool:
        """Whether the lifetime of a message is over; false while the clock of its sender is not known
        here."""
        return self._router.expired(frame, self._clock.now_ns())

    # -- events

    def _on_data(self, data: bytes, connection: IpcConnection) -> None:
        try:
            frame = decode(data)
        except WireError as error:
            self._on_malformed(str(error))
            return
        # Only frames of other users are checked: the trusted users could change the programs themselves.
        caller = None if self._callers is None else self._callers.caller(connection.uid)
        if caller is not None:
            self._on_frame_of_user(frame, caller, connection)
            return
        if self._relay is not None and self._router.is_for_gateway(frame):
            self._relay(frame, data)  # a passing frame does not change the router
            return
        if self._router.is_served(frame):
            self._driver.feed(self._router.on_arrival(frame, connection, self._clock.now_ns()))
            return
        self._refresh_for(frame)
        self._driver.feed(self._router.on_frame(frame, connection, self._clock.now_ns()))

    def _on_frame_of_user(self, frame: Frame, caller: Caller, connection: IpcConnection) -> None:
        """A frame of another user of this computer, who has the rights that the access rules give it."""
        assert self._callers is not None
        # a frame for another platform is judged there; only the role of the user is added here
        onward, now_ns = self._router.leaves_node(frame), self._clock.now_ns()
        try:
            self._check_kind(frame, caller, connection, onward=onward)
            frame.extension = (
                with_caller(frame.extension, caller)
                if onward
                else with_sender(frame.extension, self._callers.sender(caller))
            )
        except WireError as error:
            self._on_malformed(str(error))
            return
        if onward:
            if self._relay is not None:
                self._relay(frame, None)
                return
        elif answerable(frame):
            self._refresh_for(frame)
            path = self._table.path_of(frame.data_id)
            if path is None:
                # also while an application is about to declare it: without its path no right can be checked
                refusal = self._router.on_refusal(frame, (Status.ABSENT, ABSENT), connection, now_ns)
                self._driver.feed(refusal)
                return
            try:
                self._callers.check(caller, path, now_ns)
            except Denied as error:
                self._driver.feed(self._router.on_denial(frame, str(error), connection, now_ns))
                return
        self._refresh_for(frame)
        self._driver.feed(self._router.on_frame(frame, connection, now_ns))

    def _check_kind(self, frame: Frame, caller: Caller, connection: IpcConnection, *, onward: bool) -> None:
        """Check that a user may send such a frame: a message or request of this node, or the answer of the
        application that serves the address, over the connection on which it was asked.

        Raises: WireError.
        """
        # a user must not send frames in the name of another platform
        if onward and not self._router.is_own(frame):
            raise WireError(f"sender {frame.sender_hw:08x} in a frame of {caller.name}")
        if answerable(frame):
            return
        if frame.kind not in ANSWERS:
            raise WireError(f"frame of kind {frame.kind.name.lower()} of {caller.name}")
        self._refresh()
        server = self._table.serving(frame.data_id)
        # an answer counts only from the process that was asked
        if server is None or not connection.address or server.endpoint != connection.address:
            raise WireError(f"answer of {caller.name}, whose program was not asked")

    def _on_malformed(self, reason: str) -> None:
        log.debug("from a process of this node: %s", reason)
        self._router.count_malformed()

    def _refresh_for(self, frame: Frame) -> None:
        """Look for changed applications, if the route of the frame depends on them.

        An open connection to the process saves the look-up: if it no longer serves the address, it passes the
        frame on or refuses it, and a retransmission looks again.
        """
        if not self._router.needs_applications(frame):
            return
        if self._table.version == self._table_version:
            address = self._router.process_of(frame)
            if address is not None and self._transport.is_connected(address):
                return
        self._refresh()

    def _refresh(self, *, probe: bool = False) -> None:
        """Report the applications of the node to the router when they have changed."""
        table = self._table
        table.refresh(probe=probe)
        if table.version == self._table_version:
            return
        self._table_version = table.version
        broker = table.named(BROKER)
        self._driver.feed(
            self._router.on_applications(
                table.endpoints,
                table.serving_endpoints,
                None if broker is None else broker.endpoint,
                self._clock.now_ns(),
            )
        )

    def _on_arrival(self, frame: Frame) -> None:
        self._driver.feed(self._router.on_arrival(frame, None, self._clock.now_ns()))

    def _on_reply(self, frame: Frame, via: Via, reply: Reply) -> None:
        now_ns = self._clock.now_ns()
        reply = self._large.on_reply(frame, reply, now_ns)
        self._driver.feed(self._router.on_handler_reply(frame, via, reply, now_ns))

    # -- actions

    def _perform(self, action: Action) -> None:
        match action:
            case ToProcess(address, frame):
                self._transport.send(address, encode(frame), urgent=frame.is_urgent)
            case ToGateway(frame):
                if self._gateway is not None:
                    self._gateway(frame)
            case SendBack(via, frame):
                self._send_back(via, frame)
            case HandOver(frame, via, takes):
                self._hand_over(frame, via, takes)
            case Complete(key, outcome):
                self._complete(key, outcome)
            case Replied(key, reply):
                request = self._requests.pop(key, None)
                if request is not None and not request.done():
                    request.set_result(reply)
            case Arrive(frame):
                self._loop.call_soon(self._on_arrival, frame)
            case Repeat(frame):
                self._driver.feed(self._router.on_repeat(frame, self._clock.now_ns()))
            case Probe():
                self._refresh(probe=True)
            case KeepConnections(addresses):
                self._transport.keep_only(addresses)

    def _send_back(self, via: Via, frame: Frame) -> None:
        assert isinstance(via, IpcConnection)
        if not via.send(encode(frame), urgent=frame.is_urgent):
            self._refresh()
            self._driver.feed(self._router.on_connection_closed(frame, self._clock.now_ns()))

    def _hand_over(self, frame: Frame, via: Via, takes: Takes) -> None:
        if takes is Takes.DATAGRAMS:
            if (receive := self._datagram_handlers.get(frame.data_id)) is not None:
                receive(frame)
        elif takes is Takes.REQUESTS:
            if (handle := self._request_handlers.get(frame.data_id)) is not None:
                request = self._large.on_request(frame, self._clock.now_ns())
                if isinstance(request, Frame):
                    handle(request, partial(self._on_reply, frame, via))
                else:
                    self._on_reply(frame, via, request)
        elif (take := self._message_handlers.get(frame.data_id)) is not None:
            outcome = self._parts.on_frame(frame, take, self._clock.now_ns())
            self._driver.feed(self._router.on_outcome(frame, via, outcome, self._clock.now_ns()))

    def _complete(self, key: Key, outcome: Outcome) -> None:
        message = self._messages.pop(key, None)
        if message is not None:
            if not message.done():
                message.set_result(outcome)
            return
        request = self._requests.pop(key, None)
        if request is not None and not request.done():
            kind = "NotFound" if outcome.status is Status.REFUSED else "NoAnswer"
            request.set_exception(from_kind(kind, str(outcome)))

    def tend(self) -> Path | None:
        """Listen again if the file of the socket was removed; its path, or None if it stands.

        Raises: OSError.
        """
        return self._transport.tend()

    def close(self) -> None:
        """Close the sockets; messages and requests without an outcome end as unreachable."""
        self._driver.stop()
        gone = Outcome(Status.UNREACHABLE, self._platform, "this application ends")
        # A copy of the keys: completing one removes it from the table.
        for key in [*self._messages, *self._requests]:
            self._complete(key, gone)
        self._transport.close()
