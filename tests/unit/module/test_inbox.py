"""An inbox: every message once and in order, a bound on those that wait, and a turn for others."""

import asyncio
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmware.errors import InvalidInput, NotFound, OutOfRange
from swarmware.model.frame import PAYLOAD_LIMIT, Frame, FrameKind
from swarmware.model.names import ANY, data_id, hardware_id
from swarmware.module.inbox import FAIR, Inbox
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.delivery.outcome import Status
from swarmware.transport.delivery.parts import VALUE_LIMIT
from swarmware.types import registry
from swarmware.types.scalar import Blob, Int, Text


def message(number: int) -> Frame:
    payload = registry.encode(Int(number))
    return Frame(
        FrameKind.MESSAGE, data_id("cmd/step", "Int"), hardware_id("uav7"), 9, 0, ANY, number, payload=payload
    )


async def test_messages_are_taken_in_order_with_sender(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        box: Inbox[Int] = m.inbox("cmd/step", Int)
        assert (box.take(), box.meta) == (None, None)
        for number in (3, 1, 2):
            found = box.put(message(number))
            assert found is not None
            assert (found.status, found.where) == (Status.DELIVERED, "uav1:planner#1")
        assert len(box) == 3
        taken = [(box.take(), box.meta.sequence if box.meta else -1) for _ in range(3)]
        assert taken == [(Int(3), 3), (Int(1), 1), (Int(2), 2)]
        assert box.meta is not None
        assert box.meta.sender_hw == hardware_id("uav7")


async def test_full_inbox_has_room_after_taking(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        box = m.inbox("cmd/step", Int, limit=2)
        assert [box.put(message(number)) is None for number in range(3)] == [False, False, True]
        assert box.take() == Int(0)
        assert box.put(message(4)) is not None
        assert [await box.next(PATIENCE_S), await box.next(PATIENCE_S)] == [Int(1), Int(4)]


@pytest.mark.parametrize("payload", [b"", b"\xc1", registry.encode(Text("one")), b"\xff" * 100])
async def test_payload_of_another_type_is_refused_and_counted(tmp_path: Path, payload: bytes) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        box = m.inbox("cmd/step", Int)
        damaged = message(1)
        damaged.payload = payload
        found = box.put(damaged)
        assert found is not None
        assert found.status is Status.REFUSED
        assert "payload of type Int" in found.detail
        assert (box.refused, len(box)) == (1, 0)


async def test_receiver_of_many_messages_yields_to_others(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        box = m.inbox("cmd/step", Int, limit=4 * FAIR)
        turns: list[int] = []
        taken = 0

        async def other() -> None:
            while True:
                turns.append(taken)
                await asyncio.sleep(0)

        for number in range(3 * FAIR):
            box.put(message(number))
        task = asyncio.create_task(other())
        async for value in box:
            assert value.value == taken
            taken += 1
            if taken == 3 * FAIR:
                break
        task.cancel()
        assert turns[:2] == [FAIR - 1, 2 * FAIR - 1]


@pytest.mark.parametrize("kind", sorted(set(FrameKind)))
async def test_message_is_of_kind_that_inbox_takes(tmp_path: Path, kind: FrameKind) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        box = m.inbox("cmd/step", Int)
        if kind.name in {"BOARD", "MESSAGE", "NOTIFY", "EVENT", "STREAM", "FILE"}:
            assert await m.send("cmd/step", Int(1), kind=kind)
            assert await box.next(PATIENCE_S) == Int(1)
        else:
            with pytest.raises(InvalidInput, match=f"of kind {kind.name.lower()}; expected one of board"):
                await m.send("cmd/step", Int(1), kind=kind)


async def test_oversized_requests_replies_and_messages_are_split(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        box = m.inbox("cmd/blob", Blob)
        m.serve("sys/blob", Blob, lambda request, _: request, reply=Blob)
        large = Blob(bytes(PAYLOAD_LIMIT))
        assert await m.send("cmd/blob", large, timeout_s=20.0)
        assert box.take() == large
        assert await m.send("cmd/blob", Blob(b"next"))
        assert await m.request("sys/blob", large, Blob, timeout_s=20.0) == large
        m.serve("sys/zeros", Int, lambda request, _: Blob(bytes(request.value)), reply=Blob)
        for size in (PAYLOAD_LIMIT - 300, PAYLOAD_LIMIT, PAYLOAD_LIMIT + 1):
            found = await m.request("sys/zeros", Int(size), Blob, timeout_s=20.0)
            assert len(found.value) == size
        m.serve("sys/fails", Blob, lambda request, _: Blob(bytes(VALUE_LIMIT)), reply=Blob)
        with pytest.raises(OutOfRange, match=f"answer of {VALUE_LIMIT + 15} bytes: too large"):
            await m.request("sys/fails", large, Blob, timeout_s=20.0)
        with pytest.raises(OutOfRange, match=f"expected at most {VALUE_LIMIT}"):
            await m.request("sys/blob", Blob(bytes(VALUE_LIMIT)), Blob)
        with pytest.raises(NotFound):
            await m.request("sys/nobody", large, Blob, timeout_s=3.0)
