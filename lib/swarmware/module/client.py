"""The client of a node: reads resources, sends messages and requests.

What serves and writes is in `swarmware.module.module`: a command of the operator lives without it.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol, Self, TypeVar

import msgspec

from swarmware.errors import InvalidInput, NotFound, TypeMismatch, from_kind
from swarmware.model import names
from swarmware.model.access import Sender
from swarmware.model.clock import Clock
from swarmware.model.frame import ADDRESSED, Flag, Frame, FrameKind
from swarmware.module.addressing import Addressing
from swarmware.module.large_request import LargeRequest
from swarmware.module.node_participant import NodeParticipant
from swarmware.module.part_sender import send_parts
from swarmware.module.remote_clocks import RemoteClocks
from swarmware.module.ticker import Lateness, Ticker
from swarmware.node.node import Node
from swarmware.runtime.instant import stage_phase_ns
from swarmware.transport.appfile.entry import AppEntry
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.transport.delivery.parts import SPLIT_BYTES
from swarmware.transport.delivery.sender import Caller, with_caller
from swarmware.types import registry
from swarmware.types.rpc import Empty, Reply, StreamSnapshot

if TYPE_CHECKING:
    from swarmware.module.board import BoardReader
    from swarmware.module.boardset import BoardSet
    from swarmware.module.frame_reader import FrameReader
    from swarmware.module.partners import Partners
    from swarmware.module.snapshot_stream import SnapshotStream
    from swarmware.module.stream import StreamReader

T = TypeVar("T", bound=msgspec.Struct)
R = TypeVar("R", bound=msgspec.Struct)
S = TypeVar("S", bound=msgspec.Struct)

_URGENT: Final = int(Flag.URGENT)
_BULK: Final = int(Flag.BULK)
_ACKED: Final = int(Flag.WANTS_ACK)
_ACKED_URGENT: Final = _ACKED | _URGENT


class _Closes(Protocol):
    def close(self) -> None: ...


C = TypeVar("C", bound=_Closes)


class _Membership(NamedTuple):
    """State of a client while it is on its node."""

    participant: NodeParticipant
    addressing: Addressing
    tasks: asyncio.TaskGroup
    leave_signals: Callable[[type[BaseException] | None], None]
    clock: Clock


class Client:
    """`async with Client("tool") as c`: joins the node to read and to ask; leaves it at the end, also after
    SIGTERM or SIGINT.

    It does not contend for the role of the master. Raises: as `Module`.
    """

    def __init__(
        self,
        name: str,
        *,
        node: Node | None = None,
        instance: int | None = None,
        config_dir: Path | str | None = None,
    ) -> None:
        self.name = names.check_application(name)
        self.log = logging.getLogger(f"swarm.{name}")
        self.lateness = Lateness()
        """Lateness of the tickers of this module."""
        self._given_node = node
        self._given_instance = instance
        self._config_dir = config_dir
        self._membership: _Membership | None = None
        self._readers: list[_Closes] = []
        self._running: set[asyncio.Task[Any]] = set()

    def _participant_on(self, node: Node) -> NodeParticipant:
        """Represents this application on the node.

        Raises: Conflict when the instance runs already.
        """
        return NodeParticipant(self.name, node, instance=self._given_instance)

    async def __aenter__(self) -> Self:
        node = Node.attach(self._config_dir) if self._given_node is None else self._given_node.share()
        try:
            participant = self._participant_on(node)
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
            # without the error: it is raised by the block itself, and the group would wrap it
            await member.tasks.__aexit__(None, None, None)
        finally:
            self._close_resources()
            member.participant.close()
            self.node.close()
            # last: a second signal during the cleanup must not interrupt it
            member.leave_signals(kind)

    def _close_resources(self) -> None:
        """Close what the methods below have opened."""
        for reader in self._readers:
            reader.close()

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
        """Hardware clock of this node."""
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

    def _track(self, reader: C) -> C:
        self._readers.append(reader)
        return reader

    def close_reader(self, reader: _Closes) -> None:
        """Close one reader of this module before its end."""
        if reader in self._readers:
            self._readers.remove(reader)
        reader.close()

    # -- boards, events, streams

    def reader(self, path: str, cls: type[T], *, within_s: float | None = None) -> "BoardReader[T]":
        """Open a reader of a board of this platform, or (`/uav3/nav/pose`) of the mirror of another
        platform's.

        `within_s`: longest delay with which its values are of use here, or None if not stated. The command
        `swarmctl doctor placement` judges by it whether another computer may provide them.
        """
        return self._track(self._board(self._interest(path, within_s), cls))

    def _board(self, path: str, cls: type[T]) -> "BoardReader[T]":
        from swarmware.module.board import BoardReader  # each reader is imported by who opens one

        data_id = names.data_id(names.split(path)[1], registry.type_name(cls))
        return BoardReader(self.node, path, cls, data_id, self.remote_clocks)

    def readers(self, pattern: str, cls: type[T]) -> "BoardSet[T]":
        """Open readers of one board of all other platforms (`/*/nav/pose`): a mapping that grows as they
        appear."""
        from swarmware.module.boardset import BoardSet

        # before the interest is stated: an invalid pattern must not reach the application file
        boards = BoardSet(self.node, pattern, lambda path: self._board(path, cls))
        self._member.participant.read(pattern)
        return self._track(boards)

    def stream_reader(self, path: str, cls: type[T], *, from_oldest: bool = False) -> "StreamReader[T]":
        """Open a reader of every item or event from now on; `from_oldest`: also of those still in memory."""
        from swarmware.module.stream import StreamReader

        local = self._interest(path)
        data_id = names.data_id(names.split(local)[1], registry.type_name(cls))
        return self._track(StreamReader(self.node, local, cls, data_id, from_oldest=from_oldest))

    def history(self, path: str, cls: type[T]) -> "StreamReader[T]":
        """Open a reader of every value of a board that arrives from now on, each once.

        Values of an outage, which a buffer of the channel has kept, come after newer ones.
        """
        from swarmware.module.stream import StreamReader

        local = self._interest(path)
        data_id = names.data_id(names.split(local)[1], registry.type_name(cls))
        return self._track(StreamReader(self.node, local, cls, data_id, history=True))

    def snapshot_stream(self, path: str, cls: type[T], snapshot: type[S]) -> "SnapshotStream[T, S]":
        """Open a reader of a stream whose owner serves snapshots: first its state, then every item after it,
        in order; after a gap its state again."""
        from swarmware.module.snapshot_stream import SnapshotStream, snapshot_path

        reader = self.stream_reader(path, cls)
        address = snapshot_path(path)
        return SnapshotStream(reader, lambda: self.request(address, Empty(), StreamSnapshot), snapshot)

    def partners(self) -> "Partners":
        """The other platforms of the swarm, their units and applications, as the register daemon knows
        them."""
        from swarmware.module.partners import Partners
        from swarmware.module.unit_directory import PATH
        from swarmware.types.register import PartnerTable

        return Partners(self.reader(PATH, PartnerTable), self.clock)

    def frame_reader(self, path: str, *, every: bool = False, history: bool = False) -> "FrameReader":
        """The undecoded frames of a resource of any type; `every`: each one, as of an event or stream;
        `history`: as `history`."""
        from swarmware.module.frame_reader import FrameReader

        return self._track(FrameReader(self.node, self._interest(path), every=every, history=history))

    def _interest(self, path: str, within_s: float | None = None) -> str:
        participant = self._member.participant
        local = participant.local(path)
        # resources that each computer has for itself are never fetched from another one
        if local.startswith("/") or not names.has_unit_branch(local):
            participant.read(local, within_s)
        return local

    # -- messages

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
        this message carries out; the receiver applies and records the role and name of that user. A value
        above 64 KiB is split, and its parts have the lowest priority.
        Raises: InvalidInput for a kind that no inbox takes; OutOfRange for a value above 64 MiB.
        """
        if kind not in ADDRESSED:
            taken = ", ".join(sorted(kind.name.lower() for kind in ADDRESSED))
            raise InvalidInput(f"{path}: a message of kind {kind.name.lower()}; expected one of {taken}")
        member = self._member
        address = member.addressing.address(path, type(value))
        # at once, and with the expected type, which a later hop does not know
        if address.platform is None and (error_text := address.mismatch()):
            return Outcome(Status.REFUSED, self.platform, error_text)
        frame = member.addressing.frame(kind, address, value, timeout_s)
        frame.flags = _ACKED_URGENT if urgent else _ACKED
        self._state_caller(frame, on_behalf_of)
        messaging = member.participant.node.messaging
        parts = None if len(frame.payload) <= SPLIT_BYTES else member.addressing.parts(frame)
        if parts is None:
            outcome = await messaging.send(frame, timeout_s)
        else:
            outcome = await send_parts(messaging, parts, timeout_s)
        if outcome.status is Status.REFUSED and (error_text := address.mismatch()):
            return msgspec.structs.replace(outcome, detail=error_text)  # its server appeared during the wait
        return outcome

    def _state_caller(self, frame: Frame, sender: Sender | None) -> None:
        if sender is not None and sender.caller and sender.platform == self.platform:
            frame.extension = with_caller(frame.extension, Caller(sender.caller, sender.role))

    def post(self, path: str, value: msgspec.Struct, *, timeout_s: float = 1.0) -> None:
        """Send a datagram of video to an address: once, without an outcome; late ones are dropped on the
        way."""
        member = self._member
        address = member.addressing.address(path, type(value))
        self.node.messaging.post(member.addressing.frame(FrameKind.RTP, address, value, timeout_s))

    # -- requests

    def request(
        self,
        path: str,
        value: msgspec.Struct,
        reply: type[R],
        *,
        timeout_s: float = 2.0,
        urgent: bool = False,
        bulk: bool = False,
        on_behalf_of: Sender | None = None,
    ) -> Coroutine[Any, Any, R]:
        """Send a request to an address of this or another platform, at once; the coroutine returns the reply.

        `bulk`: it or its reply is a part of something large, and has the lowest priority on links. A request
        or reply above 4 MiB travels in parts of that priority; a large request is sent when it is awaited.
        Raises: OutOfRange for a value above 64 MiB; the error of the handler as the same class; NoAnswer at
        the time-out; NotFound for an address without a server; TypeMismatch when it takes another type.
        """
        member = self._member
        address = member.addressing.address(path, type(value))

        def mismatch() -> str:
            error_text = address.mismatch()
            return error_text and f"{error_text}, not {registry.type_name(type(value))}"

        if error_text := mismatch():
            raise TypeMismatch(error_text)
        frame = member.addressing.frame(FrameKind.REQUEST, address, value, timeout_s)
        is_bulk = bulk or len(frame.payload) > SPLIT_BYTES
        frame.flags = _URGENT if urgent else _BULK if is_bulk else 0
        self._state_caller(frame, on_behalf_of)
        large = LargeRequest(self.node.messaging, member.addressing.again, timeout_s)
        parts = None if len(frame.payload) <= SPLIT_BYTES else member.addressing.parts(frame)
        if parts is not None:
            return answer(path, large.of_parts(parts), reply, mismatch)
        comes = self.node.messaging.request(frame, timeout_s)
        return answer(path, _whole(large, frame, comes), reply, mismatch)


async def _whole(large: LargeRequest, frame: Frame, comes: asyncio.Future[Reply]) -> Reply:
    return await large.whole(frame, await comes)


async def answer(path: str, comes: Awaitable[Reply], cls: type[R], mismatch: Callable[[], str]) -> R:
    """Wait for the reply to a request that was sent.

    `mismatch` returns the reason if the address does not accept the type, or "" if it does.
    Raises: the error of the handler as its own class; NoAnswer, NotFound, TypeMismatch.
    """
    try:
        reply = await comes
    except NotFound as error:
        if error_text := mismatch():
            raise TypeMismatch(error_text) from error
        raise NotFound(f"{path}: {error}") from error
    if not reply.ok:
        raise from_kind(reply.kind, reply.error)
    return registry.decode(cls, reply.body)
