"""What a frame costs a process: counted in calls of Python functions, which no other load changes."""

import asyncio
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Final

import pytest
from tests.patience import PATIENCE_S

from swarmware.model import names
from swarmware.model.frame import HOPS, Flag, Frame, FrameKind, encode
from swarmware.model.names import ANY, data_id
from swarmware.module.module import Module
from swarmware.node.node import Node
from swarmware.testing.tmpnode import make_node, tmp_node
from swarmware.transport.appfile.table import AppTable
from swarmware.transport.messaging.endpoint import MessageEndpoint
from swarmware.transport.messaging.ipc_transport import IpcConnection, IpcTransport
from swarmware.types import registry
from swarmware.types.scalar import Blob

THERE: Final = names.hardware_id("uav7")
PASSING_CALLS: Final = 7
"""Read, take apart, decode, route, hand on: 22 while each frame became an action first."""
SENDING_CALLS: Final = 30
"""From the module to the gateway; 44 while an address was parsed for each message."""


class Calls:
    """Python functions of this program that were called."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def on_event(self, frame: FrameType, event: str, _argument: Any) -> None:
        if event == "call" and "swarmware" in frame.f_code.co_filename:
            self.names.append(frame.f_code.co_qualname)


@contextmanager
def counted() -> Iterator[Calls]:
    calls = Calls()
    before = sys.getprofile()
    sys.setprofile(calls.on_event)
    try:
        yield calls
    finally:
        sys.setprofile(before)


@asynccontextmanager
async def other_process(folder: Path) -> AsyncIterator[IpcTransport]:
    def take(_data: bytes, _connection: IpcConnection) -> None: ...

    transport = IpcTransport(folder / "other", take, lambda _: None)
    try:
        yield transport
    finally:
        transport.close()


def message(sequence: int) -> Frame:
    return Frame(FrameKind.MESSAGE, 11, 3, 5, THERE, ANY, sequence, 1, hops_left=HOPS, payload=bytes(300))


class Relay:
    """The gateway to other platforms."""

    def __init__(self, node: Node) -> None:
        self.came = asyncio.Event()
        self.own: list[Frame] = []
        self.others: list[tuple[Frame, bytes]] = []
        node.messaging.set_gateway(self.own.append, relay=self._take)

    def _take(self, frame: Frame, data: bytes | None) -> None:
        assert data is not None, "it is of the same user"
        self.others.append((frame, data))
        self.came.set()

    async def next(self) -> tuple[Frame, bytes]:
        self.came.clear()
        await asyncio.wait_for(self.came.wait(), PATIENCE_S)
        return self.others[-1]


async def test_frame_of_another_process_passes_unchanged(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, other_process(tmp_path) as other:
        relay = Relay(node)
        for sequence in range(3):
            sent = encode(message(sequence))
            other.send(node.messaging.address, sent)
            frame, data = await relay.next()
            assert (frame.sequence, data) == (sequence, sent)
        assert relay.own == []


async def test_frame_that_passes_process_costs_handful_of_calls(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, other_process(tmp_path) as other:
        relay = Relay(node)
        other.send(node.messaging.address, encode(message(0)))
        await relay.next()  # the connection is there
        other.send(node.messaging.address, encode(message(1)))
        with counted() as calls:
            await relay.next()
        assert len(calls.names) <= PASSING_CALLS, calls.names


@pytest.mark.parametrize("kind", [FrameKind.MESSAGE, FrameKind.NOTIFY])
async def test_message_to_another_platform_costs_few_calls(tmp_path: Path, kind: FrameKind) -> None:
    async with tmp_node(tmp_path) as node, Module("sender", node=node) as module:
        relay = Relay(node)
        for _ in range(2):  # the first one makes the address
            sending = module.send("/uav7/cmd/note", Blob(bytes(200)), kind=kind)
            with counted() as calls:
                sending.send(None)  # up to where it waits for the answer
            sending.close()
        assert len(relay.own) == 2
        assert len(calls.names) <= SENDING_CALLS, calls.names


class CountedTable(AppTable):
    """A table of applications that counts how often their folder is looked at."""

    looks = 0

    def refresh(self, *, probe: bool = False) -> None:
        self.looks += 1
        super().refresh(probe=probe)


async def test_applications_are_sought_until_connection_exists(
    tmp_path: Path,
) -> None:
    config_dir = make_node(tmp_path)
    sender = names.hardware_id("uav1")

    async def takes(endpoint: MessageEndpoint, sequence: int) -> None:
        frame = Frame(
            FrameKind.MESSAGE,
            data_id("cmd/note", "Blob"),
            sender,
            5,
            sender,
            ANY,
            sequence,
            flags=Flag.WANTS_ACK,
        )
        frame.payload = registry.encode(Blob(b"note"))
        outcome = await endpoint.send(frame, 10.0)
        assert outcome.delivered, outcome

    node = Node.attach(config_dir)
    table = CountedTable(node.run_dir)
    endpoint = MessageEndpoint(
        platform="uav1", hardware=sender, clock=node.clock, socket_path=tmp_path / "sender", table=table
    )
    endpoint.add_application(5)
    try:
        async with Module("first", node=node) as module:
            module.inbox("cmd/note", Blob)
            await takes(endpoint, 1)
            looks = table.looks
            assert looks
            for sequence in (2, 3, 4):
                await takes(endpoint, sequence)
            assert table.looks == looks
        node.close()
        node = Node.attach(config_dir)
        async with Module("second", node=node) as module:
            box = module.inbox("cmd/note", Blob)
            await takes(endpoint, 5)
            assert table.looks > looks, "the connection has ended: the receiver may be another one"
            assert box.take() == Blob(b"note")
    finally:
        endpoint.close()
        node.close()
