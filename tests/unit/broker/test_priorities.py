"""What modules and the tree send between platforms leaves in the order of its importance."""

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmd.broker.core.frames.send_queue import (
    AGE_MAX_NS,
    BYTES_MAX,
    ConnectionClass,
    Priority,
    SendQueue,
    connection_class,
    priority,
)
from swarmd.tree.core.action import SendNotify
from swarmd.tree.core.notification.lane import LaneNumber
from swarmware.errors import InvalidInput
from swarmware.model.frame import ADDRESSED, Flag, Frame, FrameKind, encode
from swarmware.module.module import Module
from swarmware.testing.leaks import no_leaks
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.scalar import Blob, Text
from swarmware.types.tree_exchange import TreeItem, TreeNotify

NOTE_BYTES = 32_000
LANES = {
    FrameKind.EVENT: LaneNumber.UPDATES,
    FrameKind.STREAM: LaneNumber.STREAMS,
    FrameKind.BOARD: LaneNumber.BOARDS,
}
IN_FLIGHT = 200
"""Unanswered messages to one platform, fewer than the message router allows."""


def note(platform: str, kind: FrameKind) -> SendNotify:
    """What the tree sends of a value of this kind that is due."""
    item = TreeItem("a/b", 1, kind, 0, 0, bytes(NOTE_BYTES))
    return SendNotify(platform, TreeNotify("uav1", 1, 1, (item,), lane=LANES[kind]))


def sent(tmp_path: Path, send: Callable[[Module], list[asyncio.Task[object]]]) -> SendQueue:
    """The broker's queue with all that a module of this node sent."""
    queue = SendQueue()
    came = asyncio.Event()
    seen: set[tuple[int, int, int]] = set()

    def gateway(frame: Frame) -> None:
        identity = (frame.receiver_hw, frame.data_id, frame.sequence)
        if identity not in seen:  # nobody answers, so it comes again
            seen.add(identity)
            queue.put(encode(frame), frame, 0)
            came.set()

    async def run() -> None:
        async with tmp_node(tmp_path) as node, Module("planner", node=node) as module:
            node.messaging.set_gateway(gateway)
            tasks = send(module)
            while len(seen) < len(tasks):
                came.clear()
                await came.wait()
            node.messaging.set_gateway(None)

    with no_leaks(tmp_path):
        asyncio.run(run())
    return queue


def taken(queue: SendQueue) -> dict[ConnectionClass, list[Frame]]:
    """What each connection takes, in its order."""
    frames: dict[ConnectionClass, list[Frame]] = {each: [] for each in ConnectionClass}
    for each in ConnectionClass:
        while queue.has(each):
            frames[each].append(queue.pop(each).frame)
    return frames


def notify(module: Module, action: SendNotify) -> asyncio.Task[object]:
    path = f"/{action.platform}/sys/tree/notify"
    return module.start(module.send(path, action.notify, kind=action.kind, timeout_s=60), "notify")


def test_commands_precede_notifications_then_streams_and_files(
    tmp_path: Path,
) -> None:
    def send(module: Module) -> list[asyncio.Task[object]]:
        return [
            module.start(module.send("/uav2/x/file", Blob(b"f"), kind=FrameKind.FILE), "file"),
            notify(module, note("uav2", FrameKind.BOARD)),
            notify(module, note("uav2", FrameKind.STREAM)),
            notify(module, note("uav2", FrameKind.EVENT)),
            module.start(module.send("/uav2/cmd/goto", Text("there")), "command"),
            module.start(module.request("/uav2/sys/x", Text("?"), Text), "request"),
            module.start(module.send("/uav2/cmd/abort", Text("now"), urgent=True), "abort"),
        ]

    queue = sent(tmp_path, send)
    order = taken(queue)
    assert {each: [priority(frame) for frame in frames] for each, frames in order.items()} == {
        ConnectionClass.CONTROL: [Priority.URGENT, Priority.CONTROL, Priority.CONTROL],
        ConnectionClass.DATA: [Priority.NOTIFY, Priority.STREAM, Priority.BOARD, Priority.BULK],
    }
    assert b"now" in order[ConnectionClass.CONTROL][0].payload


def test_commands_survive_tenfold_overload(tmp_path: Path) -> None:
    platforms = 10 * BYTES_MAX // (IN_FLIGHT * NOTE_BYTES) + 1

    def send(module: Module) -> list[asyncio.Task[object]]:
        tasks: list[asyncio.Task[object]] = []
        for number in range(platforms):
            kind = FrameKind.STREAM if number % 2 else FrameKind.EVENT
            tasks += [notify(module, note(f"ugv{number}", kind)) for _ in range(IN_FLIGHT)]
            command = module.send(f"/ugv{number}/cmd/goto", Text("there"), timeout_s=60)
            tasks.append(module.start(command, "command"))
        abort = module.send("/ugv1/cmd/abort", Text("now"), timeout_s=60, urgent=True)
        return [*tasks, module.start(abort, "abort")]

    queue = sent(tmp_path, send)
    order = taken(queue)
    abort, *commands = order[ConnectionClass.CONTROL]
    assert b"now" in abort.payload
    assert [frame.kind for frame in commands] == [FrameKind.MESSAGE] * platforms
    kinds = {frame.kind for frame in order[ConnectionClass.DATA]}
    assert kinds == {FrameKind.NOTIFY}, "notifications fill the queue: streams went first"


@pytest.mark.parametrize("kind", list(FrameKind))
def test_data_takes_own_connection_unless_urgent(kind: FrameKind) -> None:
    data = kind in {FrameKind.STREAM, FrameKind.NOTIFY, FrameKind.EVENT, FrameKind.BOARD, FrameKind.FILE}
    assert connection_class(Frame(kind, 5, 1, 6, 9, 7)) is (
        ConnectionClass.DATA if data else ConnectionClass.CONTROL
    )
    assert connection_class(Frame(kind, 5, 1, 6, 9, 7, flags=Flag.URGENT)) is ConnectionClass.CONTROL


@pytest.mark.parametrize("kind", [FrameKind.MESSAGE, FrameKind.REQUEST, FrameKind.REPLY])
def test_part_of_large_value_yields_to_others(kind: FrameKind) -> None:
    part = Frame(kind, 5, 1, 6, 9, 7, flags=Flag.BULK)
    assert priority(part) is Priority.BULK
    assert connection_class(part) is ConnectionClass.DATA
    queue = SendQueue()
    queue.put(b"part of a map", part, 0)
    for other in (FrameKind.BOARD, FrameKind.STREAM, FrameKind.EVENT):
        queue.put(other.name.encode(), Frame(other, 5, 1, 6, 9, 7), 1)
    order = [queue.pop(ConnectionClass.DATA).data for _ in range(4)]
    assert order == [b"EVENT", b"STREAM", b"BOARD", b"part of a map"]
    assert priority(Frame(kind, 5, 1, 6, 9, 7, flags=Flag.BULK | Flag.URGENT)) is Priority.URGENT


def test_blocked_connection_stops_only_its_classes() -> None:
    queue = SendQueue()
    queue.put(b"scan", Frame(FrameKind.NOTIFY, 5, 1, 6, 9, 7), 0)
    assert not queue.has(ConnectionClass.CONTROL)
    queue.put(b"abort", Frame(FrameKind.MESSAGE, 5, 1, 6, 9, 7), 1)
    waiting, old = queue.peek(ConnectionClass.CONTROL, AGE_MAX_NS + 1)
    assert waiting is not None
    assert (waiting.data, old) == (b"abort", [])
    assert queue.pop(ConnectionClass.CONTROL).data == b"abort"
    waiting, old = queue.peek(ConnectionClass.DATA, AGE_MAX_NS + 1)
    assert (waiting, [item.data for item in old]) == (None, [b"scan"])
    with pytest.raises(IndexError, match="the queue is empty"):
        queue.pop(ConnectionClass.DATA)


def test_a_notification_reaches_an_inbox_and_is_acknowledged(tmp_path: Path) -> None:
    async def run() -> None:
        async with tmp_node(tmp_path) as node, Module("tree", node=node) as module:
            inbox = module.inbox("sys/note", Text)
            for kind in sorted(ADDRESSED - {FrameKind.MESSAGE}):
                assert await module.send("sys/note", Text(kind.name), kind=kind)
                assert (await inbox.next(PATIENCE_S)).value == kind.name

    with no_leaks(tmp_path):
        asyncio.run(run())


@pytest.mark.parametrize("kind", [FrameKind.ACK, FrameKind.REPLY, FrameKind.REQUEST, FrameKind.HELLO])
def test_message_without_inbox_for_kind_is_refused(tmp_path: Path, kind: FrameKind) -> None:
    async def run() -> None:
        async with tmp_node(tmp_path) as node, Module("tree", node=node) as module:
            with pytest.raises(
                InvalidInput, match="expected one of board, event, file, message, notify, stream"
            ):
                await module.send("sys/note", Text("x"), kind=kind)

    with no_leaks(tmp_path):
        asyncio.run(run())
