"""The functional module: everything an application does with its node."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, Literal, Self, TypeVar, overload

import msgspec

from swarmware.errors import InvalidInput, TypeMismatch, WireError
from swarmware.model.frame import Frame
from swarmware.model.resource import Kind, Link, Plain, Resource
from swarmware.module import inbox as inbox_module
from swarmware.module.accepted import acceptance
from swarmware.module.client import Client
from swarmware.module.inbox import Inbox
from swarmware.module.meta import Meta
from swarmware.module.node_participant import NodeParticipant
from swarmware.module.rpc import Handler, Server
from swarmware.module.streamwriter import STREAM_SLOT_BYTES, STREAM_SLOTS, StreamWriter
from swarmware.module.writer import BOARD_SLOT_BYTES, BOARD_SLOTS, BoardWriter
from swarmware.node.node import Node
from swarmware.types import registry
from swarmware.types.net import Denial
from swarmware.types.rpc import Empty, StreamSnapshot

DENIED: Final = "sys/tree/denied"
"""Where the tree takes the denials of the other processes of its node."""

T = TypeVar("T", bound=msgspec.Struct)
W = TypeVar("W", bound=BoardWriter[Any])


class Module(Client):
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
        super().__init__(name, node=node, instance=instance, config_dir=config_dir)
        self.config: Any = config
        """Configuration of the service by its file, or None for a module without one."""
        self._live_settings = live_settings
        self._writers: list[BoardWriter[Any]] = []
        self._keep_boards = False

    async def __aenter__(self) -> Self:
        await super().__aenter__()
        self.node.callers.add_listener(self._report_denial)
        return self

    def _report_denial(self, denial: Denial) -> None:
        """Gives the tree, which has the audit of the node, a denial of this process."""
        self.start(self.send(DENIED, denial), "denial")

    def _participant_on(self, node: Node) -> NodeParticipant:
        # only a module that stays can be the master; a command leaves again at once
        node.contend()
        return NodeParticipant(
            self.name,
            node,
            instance=self._given_instance,
            config=self.config,
            live_settings=self._live_settings,
        )

    def _close_resources(self) -> None:
        # the tasks have ended, so a denial could not be sent any more
        self.node.callers.remove_listener(self._report_denial)
        super()._close_resources()
        for writer in self._writers:
            # the rings last: readers get the final values of the tasks
            writer.close(unlink=not self._keep_boards)

    def keep_boards(self, keep: bool = True) -> None:
        """Keep the newest values readable after the end, because the module will be restarted."""
        self._keep_boards = keep

    def provide(self, resource: Resource) -> None:
        """Add a resource of this application to its file, from which the tree reads it."""
        self._member.participant.provide(resource)

    def withdraw(self, path: str) -> None:
        """Remove a resource from the application file."""
        self._member.participant.withdraw(path)

    def apply(self, settings: Mapping[str, Plain]) -> None:
        """State in the application file which values of live settings are in force in this application."""
        self._member.participant.apply(settings)

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

    def serve_snapshots(self, writer: StreamWriter[Any], snapshot: Callable[[], msgspec.Struct]) -> Server:
        """Serve the state that the items of a stream have led to, to readers that begin or have a gap.

        `snapshot` returns the state after the item that was written last.
        Raises: Conflict when another application has the address.
        """
        from swarmware.module.snapshot_stream import snapshot_path

        def handle(_request: Empty, _meta: Meta) -> StreamSnapshot:
            return StreamSnapshot(writer.sequence, self.now_ns(), registry.encode(snapshot()))

        local = snapshot_path(writer.path)
        return self.serve(local, Empty, handle, reply=StreamSnapshot)

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
            described = msgspec.structs.replace(resource, owner=self.name)
        else:
            described = Resource(path=path, kind=Kind(kind), type=given, owner=self.name, **details)
        # two paths with one number would be mixed up in frames, which carry only the number
        self._member.participant.check_number(described)
        return described

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

    # -- messages and requests

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

    def take_datagrams(
        self, path: str, cls: type[T], take: Callable[[T, int], None], *, description: str = ""
    ) -> None:
        """Take the datagrams of video of an address: `take(value, hardware id of the sender)`.

        No right is checked: the receiver takes those that it has agreed on. Damaged ones are dropped.
        Raises: Conflict when another application has the address.
        """
        participant = self._member.participant
        local = participant.own(path)

        def on_frame(frame: Frame) -> None:
            try:
                value = registry.decode(cls, frame.payload, frame.codec)
            except WireError as error:
                self.log.debug("%s: %s", local, error)
                return
            take(value, frame.sender_hw)

        served = participant.serve(local, cls, "datagram", description=description)
        self.node.messaging.serve_datagrams(served.data_id, self.app_id, on_frame)

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

    def requester(self, meta: Meta) -> str:
        """Sender of a request, for records: `member@platform`, as authenticated.

        Without keys it is `application@platform`, with `?` for a part that is not known.
        """
        if meta.sender is not None:
            return str(meta.sender)
        if meta.sender_hw == self.node.hardware:
            entry = self.node.applications.table.application(meta.sender_app)
            return f"{'?' if entry is None else entry.id}@{self.platform}"
        conversion = self.remote_clocks.conversion(meta.sender_hw)
        return f"?@{f'{meta.sender_hw:08x}' if conversion is None else conversion.platform}"

    def requesting_platform(self, meta: Meta) -> str | None:
        """Platform that sent a request, or None for another platform without authentication."""
        if meta.sender is not None:
            return meta.sender.platform
        return self.platform if meta.sender_hw == self.node.hardware else None
