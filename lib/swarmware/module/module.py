"""The functional module: everything an application does with its node."""

import asyncio
import logging
import secrets
from collections.abc import Coroutine
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Protocol, Self, TypeVar

import msgspec

from swarmware.errors import Conflict, InvalidInput, OutOfRange, TypeMismatch
from swarmware.model import names
from swarmware.model.frame import ADDRESSED, PAYLOAD_LIMIT, Flag, Frame, FrameKind
from swarmware.model.resource import Access, Link, Resource
from swarmware.model.resource import Kind as ResourceKind
from swarmware.module import inbox as inbox_module
from swarmware.module.accepted import acceptance
from swarmware.module.answer import answer
from swarmware.module.board import BoardReader
from swarmware.module.boardset import BoardSet
from swarmware.module.inbox import Inbox
from swarmware.module.remote_clocks import RemoteClocks
from swarmware.module.rpc import Handler, Server
from swarmware.module.stream import StreamReader
from swarmware.module.streamwriter import STREAM_SLOT_BYTES, STREAM_SLOTS, StreamWriter
from swarmware.module.ticker import Lateness, Ticker
from swarmware.module.writer import BOARD_SLOT_BYTES, BOARD_SLOTS, BoardWriter
from swarmware.node.node import Node
from swarmware.runtime.instant import stage_phase_ns
from swarmware.transport.appfile.entry import AppEntry, Served
from swarmware.transport.appfile.file import AppFile
from swarmware.transport.delivery.answer import with_lifetime
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.types import registry

T = TypeVar("T", bound=msgspec.Struct)
R = TypeVar("R", bound=msgspec.Struct)


class _Closes(Protocol):
    def close(self) -> None: ...


class Module:
    """`async with Module("planner") as m`: joins the node, leaves it at the end, be it by SIGTERM or SIGINT.

    Raises: ConfigError without a node configuration, Conflict when the instance runs already.
    """

    def __init__(
        self,
        name: str,
        *,
        node: Node | None = None,
        instance: int | None = None,
        config: msgspec.Struct | None = None,
        config_dir: Path | str | None = None,
    ) -> None:
        self.name = names.check_application(name)
        self.config: Any = config
        """Effective configuration of the service; None for a module without one."""
        self.log = logging.getLogger(f"swarm.{name}")
        self.lateness = Lateness()
        """How late this module's tickers were woken."""
        self._given_node = node
        self._given_instance = instance
        self._config_dir = config_dir
        self._sequences: dict[int, int] = {}
        self._writers: list[BoardWriter[Any]] = []
        self._readers: list[_Closes] = []
        self._provides: dict[str, Resource] = {}
        self._serves: dict[str, Served] = {}
        self._reads: dict[str, None] = {}
        self._tasks: asyncio.TaskGroup
        self._running: set[asyncio.Task[Any]] = set()
        self._flush_comes = False
        self._keep_boards = False

    async def __aenter__(self) -> Self:
        node = self._given_node
        self.node = Node.attach(self._config_dir) if node is None else node.share()
        try:
            self._file = AppFile(
                self.node.run_dir,
                self.name,
                endpoint=self.node.post.endpoint,
                started_ns=self.node.clock.now_ns(),
                instance=self._given_instance,
                config=msgspec.to_builtins(self.config) if self.config is not None else None,
                announce=self.node.announce_apps,
            )
        except BaseException:
            self.node.close()
            raise
        self.instance = self._file.entry.instance
        self.app_id = self._file.entry.app_id
        self.platform = self.node.platform
        self.clock = self.node.clock
        self.remote_clocks = RemoteClocks(self.node)
        """Converts stamps of other hardware units to our clock."""
        self.node.post.add_application(self.app_id)
        self.node.post.add_clocks(self.remote_clocks)
        self._tasks = await asyncio.TaskGroup().__aenter__()
        self._leave_signals = self.node.ending.enter()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for task in list(self._running):
            task.cancel()
        try:
            await self._tasks.__aexit__(None, None, None)
        finally:
            for reader in self._readers:
                reader.close()
            for writer in self._writers:
                writer.close(unlink=not self._keep_boards)
            self.node.post.remove_clocks(self.remote_clocks)
            self.remote_clocks.close()
            self.node.post.remove_application(self.app_id)
            self._file.close()
            self.node.close()
            self._leave_signals(kind)

    # -- about itself

    @property
    def id(self) -> str:
        """Name and instance of the application: `name#instance`."""
        return f"{self.name}#{self.instance}"

    @property
    def entry(self) -> AppEntry:
        """What the application file says."""
        return self._file.entry

    def now_ns(self) -> int:
        """The present instant on this node's hardware clock."""
        return self.clock.now_ns()

    def every(self, period_s: float, stage: int = 0) -> Ticker:
        """`async for _ in m.every(0.05)`: ticks at multiples of the period on this node's clock.

        `stage`: at an instant that several share, work of a higher one sees what that of a lower one wrote:
        sensors are 0, drivers 1, what computes with them 2.
        """
        phase_ns = stage_phase_ns(self.node.config.processes, stage)
        return Ticker(self.clock, period_s, self.lateness, stage=stage, phase_ns=phase_ns)

    def start(self, coroutine: Coroutine[Any, Any, Any], name: str) -> asyncio.Task[Any]:
        """Run it beside the module, until the module ends; an error in it ends the module."""
        task = self._tasks.create_task(coroutine, name=f"{self.name}: {name}")
        self._running.add(task)
        task.add_done_callback(self._running.discard)
        return task

    def keep_boards(self, keep: bool = True) -> None:
        """Leave the newest values readable at the end: this module will be back in a moment."""
        self._keep_boards = keep

    def _track(self, reader: _Closes) -> None:
        self._readers.append(reader)

    def _local(self, path: str) -> str:
        """A path of this platform in its local form; of another, unchanged."""
        platform, local = names.split(names.check_path(path))
        return local if platform == self.platform else path

    def _own(self, path: str) -> str:
        local = self._local(path)
        if local.startswith("/"):
            raise InvalidInput(f"{path}: of another platform; expected a resource of {self.platform}")
        return local

    def _changed(self) -> None:
        if not self._flush_comes:
            self._flush_comes = True
            asyncio.get_running_loop().call_soon(self._flush)

    def _flush(self) -> None:
        self._flush_comes = False
        if self._file.closed:
            return
        self._file.write(
            msgspec.structs.replace(
                self._file.entry,
                provides=tuple(self._provides.values()),
                serves=tuple(self._serves.values()),
                reads=tuple(self._reads),
            )
        )

    def provide(self, resource: Resource) -> None:
        """State a resource of this application in its file, where the tree finds it."""
        if resource.owner != self.name:
            resource = msgspec.structs.replace(resource, owner=self.name)
        self._provides[resource.path] = resource
        self._changed()

    def withdraw(self, path: str) -> None:
        """Take a resource back."""
        if self._provides.pop(path, None) is not None:
            self._changed()

    # -- boards, events, streams

    def writer(
        self,
        path: str,
        cls: type[T],
        *,
        kind: Literal["board", "event", "stream", "setting"] = "board",
        unit: str = "",
        rate_hz: float = 0.0,
        description: str = "",
        access: Access = "r",
        log: str = "none",
        link: Link = "",
        max_age_s: float = 0.0,
        critical: bool = False,
        resource: Resource | None = None,
        slots: int | None = None,
        slot_bytes: int | None = None,
    ) -> BoardWriter[T]:
        """The one writer of a resource of this platform; `resource`: its whole descriptor instead.

        Raises: Conflict when another process writes it, InvalidInput.
        """
        local = self._own(path)
        if resource is None:
            try:
                resource = Resource(
                    path=local,
                    kind=ResourceKind(kind),
                    type=registry.type_name(cls),
                    unit=unit,
                    rate_hz=rate_hz,
                    description=description,
                    access=access,
                    log=log,
                    link=link,
                    max_age_s=max_age_s,
                    critical=critical,
                    owner=self.name,
                )
            except ValueError as error:
                raise InvalidInput(str(error)) from error
        board = resource.kind in {ResourceKind.BOARD, ResourceKind.SETTING}
        publication = self.node.publication(
            local,
            slots=slots or (BOARD_SLOTS if board else STREAM_SLOTS),
            slot_bytes=slot_bytes or (BOARD_SLOT_BYTES if board else STREAM_SLOT_BYTES),
        )
        writer: BoardWriter[T]
        if board:
            writer = BoardWriter(self.node, self.app_id, resource, cls, publication)
        else:
            writer = StreamWriter(self.node, self.app_id, resource, cls, publication, self.remote_clocks)
        self._writers.append(writer)
        self.provide(resource)
        return writer

    def stream_writer(
        self,
        path: str,
        cls: type[T],
        *,
        slots: int = STREAM_SLOTS,
        slot_bytes: int = STREAM_SLOT_BYTES,
        kind: Literal["stream", "event"] = "stream",
        rate_hz: float = 0.0,
        description: str = "",
        log: str = "none",
        link: Link = "",
    ) -> StreamWriter[T]:
        """The one writer of a stream or of events: readers get every item, in order."""
        writer = self.writer(
            path,
            cls,
            kind=kind,
            rate_hz=rate_hz,
            description=description,
            log=log,
            link=link,
            slots=slots,
            slot_bytes=slot_bytes,
        )
        assert isinstance(writer, StreamWriter)
        return writer

    def close_writer(self, writer: BoardWriter[Any]) -> None:
        """Withdraw one resource before the module ends."""
        if writer in self._writers:
            self._writers.remove(writer)
            writer.close()
            self.withdraw(writer.path)

    def reader(self, path: str, cls: type[T]) -> BoardReader[T]:
        """The newest value of a board, of this platform or (`/uav3/nav/pose`) mirrored from another."""
        local = self._interest(path)
        reader = self._board(local, cls)
        self._track(reader)
        return reader

    def _board(self, path: str, cls: type[T]) -> BoardReader[T]:
        data_id = names.data_id(names.split(path)[1], registry.type_name(cls))
        return BoardReader(self.node, path, cls, data_id, self.remote_clocks)

    def readers(self, pattern: str, cls: type[T]) -> BoardSet[T]:
        """The same board of all other platforms: `/*/nav/pose`; a mapping that grows as they appear."""
        boards = BoardSet(self.node, pattern, lambda path: self._board(path, cls))
        self._reads[pattern] = None
        self._changed()
        self._track(boards)
        return boards

    def stream_reader(self, path: str, cls: type[T], *, from_oldest: bool = False) -> StreamReader[T]:
        """Every item of a stream or every event from now on; `from_oldest`: also those still in memory."""
        local = self._interest(path)
        data_id = names.data_id(names.split(local)[1], registry.type_name(cls))
        reader = StreamReader(self.node, local, cls, data_id, from_oldest=from_oldest)
        self._track(reader)
        return reader

    def _interest(self, path: str) -> str:
        local = self._local(path)
        if local.startswith("/"):
            self._reads[local] = None
            self._changed()
        return local

    # -- messages

    def inbox(
        self, path: str, cls: type[T], *, limit: int = inbox_module.LIMIT, description: str = ""
    ) -> Inbox[T]:
        """The inbox of an address of this platform.

        Raises: Conflict when another application has it.
        """
        local = self._own(path)
        box = Inbox(self.node, self.id, local, cls, limit, acceptance(self.node, local, self._track))
        served = self._claim(local, cls, "message", "", description)
        self.node.post.serve_messages(served.data_id, self.app_id, box.put)
        return box

    def _claim(
        self,
        path: str,
        cls: type[msgspec.Struct],
        kind: Literal["message", "request"],
        reply: str,
        description: str,
    ) -> Served:
        table = self.node.table
        table.refresh()
        other = table.serving_path(path)
        if other is not None and other[0].id != self.id:
            table.refresh(probe=True)  # it may have died
            other = table.serving_path(path)
        if other is not None and other[0].id != self.id:
            raise Conflict(f"{path}: served by {other[0].id} already; expected one application only")
        served = Served(path=path, type=registry.type_name(cls), kind=kind)
        self._serves[path] = served
        self.provide(
            Resource(
                path=path,
                kind=ResourceKind.COMMAND,
                type=served.type,
                reply=reply,
                description=description,
                access="rw",
            )
        )
        return served

    async def send(
        self,
        path: str,
        value: msgspec.Struct,
        *,
        timeout_s: float = 2.0,
        urgent: bool = False,
        kind: FrameKind = FrameKind.MESSAGE,
    ) -> Outcome:
        """Send a message to an address here or (`/uav3/cmd/goto`) on another platform; what became of it.

        `kind`: how urgent it is on a link; what is no command goes as notify, event, stream or file,
        behind all commands.
        Raises: InvalidInput for a kind that no inbox takes.
        """
        if kind not in ADDRESSED:
            taken = ", ".join(sorted(kind.name.lower() for kind in ADDRESSED))
            raise InvalidInput(f"{path}: a message of kind {kind.name.lower()}; expected one of {taken}")
        local = self._local(path)
        platform, name = names.split(local)
        data_id = names.data_id(name, registry.type_name(type(value)))
        if platform is None and (wrong := self._other_type(name, data_id)):
            return Outcome(Status.REFUSED, self.platform, wrong)
        frame = self._frame(kind, platform, data_id, value, timeout_s)
        frame.flags = Flag.WANTS_ACK | (Flag.URGENT if urgent else 0)
        outcome = await self.node.post.send(frame, timeout_s)
        if (
            platform is None
            and outcome.status is Status.REFUSED
            and (wrong := self._other_type(name, data_id))
        ):
            return msgspec.structs.replace(outcome, detail=wrong)  # its owner came while we waited
        return outcome

    def _frame(
        self, kind: FrameKind, platform: str | None, data_id: int, value: msgspec.Struct, timeout_s: float
    ) -> Frame:
        payload = registry.encode(value)
        if len(payload) > PAYLOAD_LIMIT:
            raise OutOfRange(f"a value of {len(payload)} bytes: expected at most {PAYLOAD_LIMIT}")
        # a random start: a restarted application is not taken for a duplicate of its former self
        sequence = self._sequences.get(data_id)
        sequence = secrets.randbits(32) if sequence is None else (sequence + 1) & 0xFFFF_FFFF
        self._sequences[data_id] = sequence
        return Frame(
            kind,
            data_id,
            self.node.hardware,
            self.app_id,
            self.node.hardware if platform is None else names.hardware_id(platform),
            names.ANY,
            sequence,
            self.clock.now_ns(),
            extension=with_lifetime(timeout_s),
            payload=payload,
        )

    def _other_type(self, path: str, data_id: int) -> str:
        """Why a local address cannot take this value; empty when it can, or nobody is there yet."""
        table = self.node.table
        table.refresh()
        if table.serving(data_id) is not None:
            return ""
        found = table.serving_path(path)
        return "" if found is None else f"{path} of {found[0].id} takes {found[1].type}"

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
        """Answer the requests of an address: `handler(request, meta)` gives the answer, or a coroutine of it.

        A SwarmError of the handler is raised at the caller as the same class.
        Raises: Conflict when another application has the address.
        """
        local = self._own(path)
        reply_name = registry.type_name(reply) if reply is not None else ""
        served = self._claim(local, cls, "request", reply_name, description)
        server = Server(local, cls, handler, self.start, acceptance(self.node, local, self._track))
        self.node.post.serve_requests(served.data_id, self.app_id, server.on_request)
        return server

    def request(
        self,
        path: str,
        value: msgspec.Struct,
        reply: type[R],
        *,
        timeout_s: float = 2.0,
        urgent: bool = False,
    ) -> Coroutine[Any, Any, R]:
        """Ask an address here or on another platform; the question leaves now, the coroutine has the answer.

        Raises: the error of the handler as its own class; NoAnswer in time; NotFound when nobody serves it;
        TypeMismatch when it takes another type.
        """
        local = self._local(path)
        platform, name = names.split(local)
        data_id = names.data_id(name, registry.type_name(type(value)))

        def mismatch() -> str:
            wrong = "" if platform else self._other_type(name, data_id)
            return wrong and f"{wrong}, not {registry.type_name(type(value))}"

        if wrong := mismatch():
            raise TypeMismatch(wrong)
        frame = self._frame(FrameKind.REQUEST, platform, data_id, value, timeout_s)
        frame.flags = Flag.URGENT if urgent else 0
        return answer(path, self.node.post.request(frame, timeout_s), reply, mismatch)
