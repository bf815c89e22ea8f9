"""The functional module: everything an application does with its node."""

import asyncio
import logging
from collections.abc import Callable, Coroutine, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Literal, NamedTuple, Protocol, Self, TypeVar, overload

import msgspec

from swarmware.errors import InvalidInput, TypeMismatch
from swarmware.model import names
from swarmware.model.access import Sender
from swarmware.model.clock import Clock
from swarmware.model.frame import ADDRESSED, Flag, Frame, FrameKind
from swarmware.model.resource import Kind, Link, Resource
from swarmware.module import inbox as inbox_module
from swarmware.module.accepted import acceptance
from swarmware.module.addressing import Addressing
from swarmware.module.board import BoardReader
from swarmware.module.boardset import BoardSet
from swarmware.module.frame_reader import FrameReader
from swarmware.module.inbox import Inbox
from swarmware.module.node_participant import NodeParticipant
from swarmware.module.partners import PATH as PARTNERS
from swarmware.module.partners import Partners
from swarmware.module.remote_clocks import RemoteClocks
from swarmware.module.rpc import Handler, Server, answer
from swarmware.module.stream import StreamReader
from swarmware.module.streamwriter import STREAM_SLOT_BYTES, STREAM_SLOTS, StreamWriter
from swarmware.module.ticker import Lateness, Ticker
from swarmware.module.writer import BOARD_SLOT_BYTES, BOARD_SLOTS, BoardWriter
from swarmware.node.node import Node
from swarmware.runtime.instant import stage_phase_ns
from swarmware.transport.appfile.entry import AppEntry
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.transport.delivery.sender import Caller, with_caller
from swarmware.types import registry
from swarmware.types.register import PartnerTable

T = TypeVar("T", bound=msgspec.Struct)
R = TypeVar("R", bound=msgspec.Struct)
W = TypeVar("W", bound=BoardWriter[Any])

_URGENT: Final = int(Flag.URGENT)
_ACKED: Final = int(Flag.WANTS_ACK)
_ACKED_URGENT: Final = _ACKED | _URGENT


class _Closes(Protocol):
    def close(self) -> None: ...


C = TypeVar("C", bound=_Closes)


class _Membership(NamedTuple):
    """State of a module while it is on its node."""

    participant: NodeParticipant
    addressing: Addressing
    tasks: asyncio.TaskGroup
    leave_signals: Callable[[type[BaseException] | None], None]
    clock: Clock


class Module:
    """`async with Module("planner") as m`: joins the node, and leaves it at the end, also after SIGTERM or
    SIGINT.

    Raises: ConfigError without a node configuration; Conflict when the instance runs already; InvalidInput
    when a method is called outside of `async with`.
    """

    def __init__(
        self,
        name: str,
        *,
        node: Node | None = None,
        instance: int | None = None,
        config: msgspec.Struct | None = None,
        live_settings: Mapping[str, str] | None = None,
        config_dir: Path | str | None = None,
    ) -> None:
        self.name = names.check_application(name)
        self.config: Any = config
        """Configuration of the service by its file; None for a module without one."""
        self.log = logging.getLogger(f"swarm.{name}")
        self.lateness = Lateness()
        """Lateness of this module's tickers."""
        self._given_node = node
        self._given_instance = instance
        self._live_settings = live_settings
        self._config_dir = config_dir
        self._membership: _Membership | None = None
        self._writers: list[BoardWriter[Any]] = []
        self._readers: list[_Closes] = []
        self._running: set[asyncio.Task[Any]] = set()
        self._keep_boards = False

    async def __aenter__(self) -> Self:
        node = Node.attach(self._config_dir) if self._given_node is None else self._given_node.share()
        try:
            participant = NodeParticipant(
                self.name,
                node,
                instance=self._given_instance,
                config=self.config,
                live_settings=self._live_settings,
            )
        except BaseException:
            node.close()
            raise
        self._membership = _Membership(
            participant,
            Addressing(participant),
            await asyncio.TaskGroup().__aenter__(),
            node.ending.enter(),
            node.clock,
        )
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        member = self._member
        for task in list(self._running):
            task.cancel()
        try:
            await member.tasks.__aexit__(None, None, None)
        finally:
            for reader in self._readers:
                reader.close()
            for writer in self._writers:
                writer.close(unlink=not self._keep_boards)
            member.participant.close()
            self.node.close()
            member.leave_signals(kind)

    @property
    def _member(self) -> _Membership:
        if self._membership is None:
            raise InvalidInput(f"module {self.name}: not on a node; expected use inside `async with`")
        return self._membership

    # -- identity

    @property
    def id(self) -> str:
        """Name and instance of the application: `name#instance`."""
        return self._member.participant.id

    @property
    def entry(self) -> AppEntry:
        """Content of the application file."""
        return self._member.participant.entry

    @property
    def node(self) -> Node:
        """The node that it has joined."""
        return self._member.participant.node

    @property
    def platform(self) -> str:
        """Name of the platform."""
        return self.node.platform

    @property
    def instance(self) -> int:
        """Instance number among the running modules of this name."""
        return self.entry.instance

    @property
    def app_id(self) -> int:
        """Application id, the sender of its frames."""
        return self._member.participant.app_id

    @property
    def clock(self) -> Clock:
        """This node's hardware clock."""
        return self._member.clock

    @property
    def remote_clocks(self) -> RemoteClocks:
        """Converts stamps of other hardware units to the clock of this node."""
        return self._member.participant.remote_clocks

    def now_ns(self) -> int:
        """The present instant on this node's hardware clock."""
        return self._member.clock.now_ns()

    def every(self, period_s: float, stage: int = 0) -> Ticker:
        """`async for _ in m.every(0.05)`: ticks at multiples of the period on this node's clock.

        `stage`: order of tasks with a common instant; a task reads values that tasks of lower stages wrote at
        the same instant. Sensors have 0, drivers 1, computations with their values 2.
        """
        phase_ns = stage_phase_ns(self.node.config.processes, stage)
        return Ticker(self.clock, period_s, self.lateness, stage=stage, phase_ns=phase_ns)

    def start(self, coroutine: Coroutine[Any, Any, Any], name: str) -> asyncio.Task[Any]:
        """Run a coroutine until the module ends; an error in it ends the module."""
        task = self._member.tasks.create_task(coroutine, name=f"{self.name}: {name}")
        self._running.add(task)
        task.add_done_callback(self._running.discard)
        return task

    def keep_boards(self, keep: bool = True) -> None:
        """Keep the newest values readable after the end, because the module will be restarted."""
        self._keep_boards = keep

    def _track(self, reader: C) -> C:
        self._readers.append(reader)
        return reader

    def provide(self, resource: Resource) -> None:
        """Add a resource of this application to its file, from which the tree reads it."""
        self._member.participant.provide(resource)

    def withdraw(self, path: str) -> None:
        """Remove a resource from the application file."""
        self._member.participant.withdraw(path)

    # -- boards, events, streams

    @overload
    def writer(
        self,
        resource: str,
        cls: type[T],
        *,
        unit: str = "",
        rate_hz: float = 0.0,
        log: str = "none",
        link: Link = "",
        description: str = "",
    ) -> BoardWriter[T]: ...

    @overload
    def writer(self, resource: Resource, cls: type[T]) -> BoardWriter[T]: ...

    def writer(self, resource: str | Resource, cls: type[T], **details: Any) -> BoardWriter[T]:
        """Open the writer of a board, given by its path or its descriptor, or of a setting, given by its
        descriptor.

        Raises: Conflict when another process writes it, InvalidInput.
        """
        described = self._described(resource, cls, (Kind.BOARD, Kind.SETTING), details)
        node, participant = self.node, self._member.participant
        publication = node.publication(described.path, slots=BOARD_SLOTS, slot_bytes=BOARD_SLOT_BYTES)
        return self._provided(BoardWriter(node, participant.app_id, described, cls, publication))

    @overload
    def stream_writer(
        self,
        resource: str,
        cls: type[T],
        *,
        kind: Literal["stream", "event"] = "stream",
        rate_hz: float = 0.0,
        log: str = "none",
        link: Link = "",
        description: str = "",
        slots: int = STREAM_SLOTS,
        slot_bytes: int = STREAM_SLOT_BYTES,
    ) -> StreamWriter[T]: ...

    @overload
    def stream_writer(
        self,
        resource: Resource,
        cls: type[T],
        *,
        slots: int = STREAM_SLOTS,
        slot_bytes: int = STREAM_SLOT_BYTES,
    ) -> StreamWriter[T]: ...

    def stream_writer(
        self,
        resource: str | Resource,
        cls: type[T],
        *,
        slots: int = STREAM_SLOTS,
        slot_bytes: int = STREAM_SLOT_BYTES,
        **details: Any,
    ) -> StreamWriter[T]:
        """Open the writer of a stream or of events: readers get every item, in order.

        `slots`: number of items that remain readable for slow readers, each of about `slot_bytes`.
        Raises: Conflict when another process writes it, InvalidInput.
        """
        described = self._described(resource, cls, (Kind.STREAM, Kind.EVENT), details)
        node, participant = self.node, self._member.participant
        publication = node.publication(described.path, slots=slots, slot_bytes=slot_bytes)
        return self._provided(
            StreamWriter(node, participant.app_id, described, cls, publication, participant.remote_clocks)
        )

    def _described(
        self, resource: str | Resource, cls: type[T], kinds: tuple[Kind, Kind], details: dict[str, Any]
    ) -> Resource:
        """The complete descriptor of the resource to be written."""
        self._member.participant.declare(cls)
        if isinstance(resource, Resource):
            path, kind, given = resource.path, resource.kind, resource.type
            if details:
                raise InvalidInput(f"{path}: {', '.join(details)}: expected inside the descriptor")
        else:
            path, kind = self._member.participant.own(resource), details.pop("kind", kinds[0])
            given = registry.type_name(cls)
        if kind not in kinds:
            raise InvalidInput(f"{path}: of kind {kind}; expected {' or '.join(kinds)}")
        if given != registry.type_name(cls):
            raise TypeMismatch(f"{path}: {registry.type_name(cls)}; its descriptor expects {given}")
        if isinstance(resource, Resource):
            return msgspec.structs.replace(resource, owner=self.name)
        return Resource(path=path, kind=Kind(kind), type=given, owner=self.name, **details)

    def _provided(self, writer: W) -> W:
        self._writers.append(writer)
        self.provide(writer.resource)
        return writer

    def close_writer(self, writer: BoardWriter[Any]) -> None:
        """Withdraw one resource of this module before its end."""
        if writer in self._writers:
            self._writers.remove(writer)
            writer.close()
            self.withdraw(writer.path)

    def reader(self, path: str, cls: type[T]) -> BoardReader[T]:
        """Open a reader of a board of this platform, or (`/uav3/nav/pose`) of the mirror of another
        platform's."""
        return self._track(self._board(self._interest(path), cls))

    def _board(self, path: str, cls: type[T]) -> BoardReader[T]:
        data_id = names.data_id(names.split(path)[1], registry.type_name(cls))
        return BoardReader(self.node, path, cls, data_id, self.remote_clocks)

    def readers(self, pattern: str, cls: type[T]) -> BoardSet[T]:
        """Open readers of one board of all other platforms (`/*/nav/pose`): a mapping that grows as they
        appear."""
        boards = BoardSet(self.node, pattern, lambda path: self._board(path, cls))
        self._member.participant.read(pattern)
        return self._track(boards)

    def stream_reader(self, path: str, cls: type[T], *, from_oldest: bool = False) -> StreamReader[T]:
        """Open a reader of every item or event from now on; `from_oldest`: also of those still in memory."""
        local = self._interest(path)
        data_id = names.data_id(names.split(local)[1], registry.type_name(cls))
        return self._track(StreamReader(self.node, local, cls, data_id, from_oldest=from_oldest))

    def partners(self) -> Partners:
        """The other platforms of the swarm, their units and applications, as the register daemon knows
        them."""
        return Partners(self.reader(PARTNERS, PartnerTable), self.clock)

    def frame_reader(self, path: str, *, every: bool = False) -> FrameReader:
        """The undecoded frames of a resource of any type; `every`: each one, as of an event or stream."""
        return self._track(FrameReader(self.node, self._interest(path), every=every))

    def _interest(self, path: str) -> str:
        participant = self._member.participant
        local = participant.local(path)
        if local.startswith("/"):
            participant.read(local)
        return local

    # -- messages

    def inbox(
        self, path: str, cls: type[T], *, limit: int = inbox_module.LIMIT, description: str = ""
    ) -> Inbox[T]:
        """Open the inbox of an address of this platform.

        Raises: Conflict when another application has it.
        """
        participant = self._member.participant
        local = participant.own(path)
        box = Inbox(self.node, self.id, local, cls, limit, acceptance(self.node, local, self._track))
        served = participant.serve(local, cls, "message", description=description)
        self.node.messaging.serve_messages(served.data_id, self.app_id, box.put)
        return box

    async def send(
        self,
        path: str,
        value: msgspec.Struct,
        *,
        timeout_s: float = 2.0,
        urgent: bool = False,
        kind: FrameKind = FrameKind.MESSAGE,
        on_behalf_of: Sender | None = None,
    ) -> Outcome:
        """Send a message to an address of this platform or (`/uav3/cmd/goto`) another one; returns its
        outcome.

        `kind`: its priority on a link; a message that is not a command has kind notify, event, stream or
        file, with a lower priority than commands. `on_behalf_of`: the user of this computer whose request
        this message carries out; the receiver applies and records the role and name of that user.
        Raises: InvalidInput for a kind that no inbox takes.
        """
        if kind not in ADDRESSED:
            taken = ", ".join(sorted(kind.name.lower() for kind in ADDRESSED))
            raise InvalidInput(f"{path}: a message of kind {kind.name.lower()}; expected one of {taken}")
        member = self._member
        address = member.addressing.address(path, type(value))
        if address.platform is None and (error_text := address.mismatch()):
            return Outcome(Status.REFUSED, self.platform, error_text)
        frame = member.addressing.frame(kind, address, value, timeout_s)
        frame.flags = _ACKED_URGENT if urgent else _ACKED
        self._state_caller(frame, on_behalf_of)
        outcome = await member.participant.node.messaging.send(frame, timeout_s)
        if outcome.status is Status.REFUSED and (error_text := address.mismatch()):
            return msgspec.structs.replace(outcome, detail=error_text)  # its server appeared during the wait
        return outcome

    def _state_caller(self, frame: Frame, sender: Sender | None) -> None:
        if sender is not None and sender.caller and sender.platform == self.platform:
            frame.extension = with_caller(frame.extension, Caller(sender.caller, sender.role))

    # -- requests

    def serve(
        self,
        path: str,
        cls: type[msgspec.Struct],
        handler: Handler,
        *,
        reply: type[msgspec.Struct] | None = None,
        description: str = "",
    ) -> Server:
        """Serve the requests of an address: `handler(request, meta)` returns the reply, or a coroutine of it.

        A SwarmError of the handler is raised at the caller as the same class.
        Raises: Conflict when another application has the address.
        """
        participant = self._member.participant
        local = participant.own(path)
        reply_name = registry.type_name(reply) if reply is not None else ""
        if reply is not None:
            participant.declare(reply)
        served = participant.serve(local, cls, "request", reply=reply_name, description=description)
        server = Server(local, cls, handler, self.start, acceptance(self.node, local, self._track))
        self.node.messaging.serve_requests(served.data_id, self.app_id, server.on_request)
        return server

    def request(
        self,
        path: str,
        value: msgspec.Struct,
        reply: type[R],
        *,
        timeout_s: float = 2.0,
        urgent: bool = False,
        on_behalf_of: Sender | None = None,
    ) -> Coroutine[Any, Any, R]:
        """Send a request to an address of this or another platform, at once; the coroutine returns the reply.

        Raises: the error of the handler as the same class; NoAnswer at the time-out; NotFound for an address
        without a server; TypeMismatch when it takes another type.
        """
        member = self._member
        address = member.addressing.address(path, type(value))

        def mismatch() -> str:
            error_text = address.mismatch()
            return error_text and f"{error_text}, not {registry.type_name(type(value))}"

        if error_text := mismatch():
            raise TypeMismatch(error_text)
        frame = member.addressing.frame(FrameKind.REQUEST, address, value, timeout_s)
        frame.flags = _URGENT if urgent else 0
        self._state_caller(frame, on_behalf_of)
        return answer(path, self.node.messaging.request(frame, timeout_s), reply, mismatch)
