"""A module on a node: boards, streams, inboxes and requests, through the doors that users take."""

import asyncio
from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.patience import PATIENCE_S

from swarmware.errors import Denied, InvalidInput, NoAnswer, NotFound, OutOfRange, TypeMismatch
from swarmware.model import names
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.wakeup import Wakeup
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.appfile.file import AppFile
from swarmware.transport.delivery.outcome import Status
from swarmware.transport.delivery.sender import with_sender
from swarmware.types import registry
from swarmware.types.described import class_of
from swarmware.types.description import FieldDescription, StructDescription, TypeDescription
from swarmware.types.scalar import Float, Int, Text
from swarmware.types.tree_exchange import StreamLoss, StreamLosses


class Supervised(msgspec.Struct):
    """Settings of a service."""

    supervisor: str


class Counted(Wakeup):
    """Number of wake-ups of waiting tasks."""

    __slots__ = ("count",)

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def notify(self) -> None:
        self.count += 1
        super().notify()


THERE = names.hardware_id("uav7")


async def test_early_reader_sees_newest_value(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        reader = m.reader("nav/height", Float)
        assert (reader.value, reader.age_s, reader.sequence) == (None, None, 0)
        writer = m.writer("nav/height", Float, unit="m")
        for number in (1.0, 2.0):
            writer.write(Float(number))
        assert reader.value == Float(2.0)
        assert (reader.sequence, reader.meta.sender_app if reader.meta else 0) == (2, m.app_id)
        assert reader.age_s is not None
        assert reader.age_s >= 0
        with pytest.raises(NoAnswer, match="no new value"):
            await reader.changed(0.01)
        writer.write(Float(3.0), stamp_ns=7)
        assert await reader.changed(PATIENCE_S) == Float(3.0)
        assert reader.stamp_ns == 7


async def test_provided_resource_is_listed_until_withdrawn(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        async with Module("planner", node=node) as m:
            writer = m.writer("plan/step", Int)
            m.inbox("cmd/step", Int)
            await asyncio.sleep(0)  # declarations are written at the next turn of the loop
            assert [resource.path for resource in m.entry.provides] == ["plan/step", "cmd/step"]
            assert [resource.owner for resource in m.entry.provides] == ["planner", "planner"]
            m.close_writer(writer)
            await asyncio.sleep(0)  # declarations are written at the next turn of the loop
            assert [resource.path for resource in m.entry.provides] == ["cmd/step"]
            ring = node.shm_dir / "plan.step.ring"
            assert not ring.exists()
            node.table.refresh()
            assert node.table.named("planner") is not None
        node.table.refresh(probe=True)
        assert node.table.named("planner") is None


class Rain(msgspec.Struct):
    mm: float
    """Since midnight."""


class Answer(msgspec.Struct):
    rain: list[Rain]


async def test_module_describes_only_its_own_types(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("weather", node=node) as m:
        m.writer("nav/height", Float)
        assert m.entry.types == {}
        m.writer("sensor/rain", Rain)
        m.serve("cmd/rain", Int, lambda _, __: Answer([]), reply=Answer)
        m.inbox("cmd/forget", Rain)
        await asyncio.sleep(0)
        assert m.entry.types.keys() == {"Rain", "Answer"}
        found = msgspec.json.decode(m.entry.types["Answer"], type=TypeDescription)
        assert [one.name for one in found.structs] == ["Answer", "Rain"]
        assert found.structs[1].fields[0].meaning == "Since midnight."


async def test_frames_of_any_type_are_read_undecoded(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("weather", node=node) as m:
        board = m.frame_reader("sensor/rain")
        events = m.frame_reader("sensor/showers", every=True)
        writer = m.writer("sensor/rain", Rain)
        shower = m.stream_writer("sensor/showers", Rain, kind="event")
        for number in range(3):
            writer.write(Rain(float(number)))
            shower.write(Rain(float(number)))
        newest = await anext(board)
        assert (newest.sequence, registry.decode(Rain, newest.payload)) == (3, Rain(2.0))
        assert [(await anext(events)).sequence for _ in range(3)] == [1, 2, 3]
        assert events.lost == 0


async def test_first_module_of_service_has_its_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with tmp_node(tmp_path) as node:
        seen: list[dict[str, Any]] = []

        def look() -> None:
            node.table.refresh(probe=True)
            if (entry := node.table.named("guard")) is not None:
                seen.append(entry.config)

        monkeypatch.setattr(node, "announce_apps", look)
        async with Module("guard", node=node, config=Supervised("systemd")):
            assert seen[0] == {"supervisor": "systemd"}
        assert all(config == seen[0] for config in seen)


async def test_unwritable_value_is_refused_with_expectation(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        with pytest.raises(InvalidInput, match="of another platform; expected a resource of uav1"):
            m.writer("/uav7/nav/pose", Float)
        with pytest.raises(InvalidInput, match="segment"):
            m.writer("nav/Pose", Float)
        writer = m.writer("/uav1/nav/height", Float)
        assert writer.path == "nav/height"
        with pytest.raises(TypeMismatch, match="Int, expected Float"):
            writer.write(Int(1))  # type: ignore[arg-type]  # what a user without a type checker does
        with pytest.raises(OutOfRange, match="64 bits"):
            m.writer("nav/count", Int).write(Int(2**70))


async def test_stream_gives_items_in_order_counting_overruns(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        writer = m.stream_writer("plan/path", Int, slots=8)
        reader = m.stream_reader("plan/path", Int)
        for number in range(5):
            writer.write(Int(number))
        assert [(await reader.next(PATIENCE_S)).value for _ in range(5)] == [0, 1, 2, 3, 4]
        for number in range(100):
            writer.write(Int(number))
        got = []
        while (item := reader.take()) is not None:
            got.append(item.value)
        assert got == sorted(got)
        assert got[-1] == 99
        assert reader.lost + len(got) == 100
        with pytest.raises(NoAnswer, match="nothing new"):
            await reader.next(0.01)


async def test_remote_stream_counts_gaps_in_owners_sequence(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        reader = m.stream_reader("/uav7/plan/path", Int)
        mirror = node.mirror_writer("uav7", "plan/path", slots=64)
        data_id = names.data_id("plan/path", "Int")
        # items 4 to 8 were left out on the way; then the owner starts again with 1
        for sequence, stamp_ns in ((2, 2), (3, 3), (9, 9), (10, 10), (1, 11), (2, 12), (4, 14)):
            payload = registry.encode(Int(sequence))
            mirror.publish(
                encode(
                    Frame(
                        FrameKind.STREAM,
                        data_id,
                        THERE,
                        sequence=sequence,
                        stamp_ns=stamp_ns,
                        payload=payload,
                    )
                )
            )
        got = []
        while (item := reader.take()) is not None:
            got.append(item.value)
        assert got == [2, 3, 9, 10, 1, 2, 4]
        assert reader.lost == 5 + 1
        mirror.close()


async def test_stream_writer_learns_of_receivers_losses(tmp_path: Path) -> None:
    async with (
        tmp_node(tmp_path) as node,
        Module("planner", node=node) as m,
        Module("tree", node=node) as tree,
    ):
        writer = m.stream_writer("plan/path", Int)
        assert (writer.lost, writer.losses) == (0, {})
        board = tree.writer("tree/losses", StreamLosses)
        mine = (StreamLoss("plan/path", "gcs", 3), StreamLoss("plan/path", "uav2", 4))
        board.write(StreamLosses((StreamLoss("other/one", "gcs", 9), *mine)))
        assert writer.losses == {"gcs": 3, "uav2": 4}
        assert writer.lost == 7


async def test_message_is_acknowledged_with_application_that_has_it(tmp_path: Path) -> None:
    async with (
        tmp_node(tmp_path) as node,
        Module("planner", node=node) as m,
        Module("pilot", node=node) as pilot,
    ):
        box = pilot.inbox("cmd/step", Int, limit=2)
        for number in range(2):
            outcome = await m.send("cmd/step", Int(number))
            assert outcome
            assert outcome.where == f"uav1:{pilot.id}"
        full = await m.send("cmd/step", Int(2), timeout_s=0.1)
        assert full.status is Status.EXPIRED
        assert [(await box.next(PATIENCE_S)).value for _ in range(2)] == [0, 1]
        assert (
            box.meta == Meta(node.hardware, m.app_id, box.meta.sequence, box.meta.stamp_ns)
            if box.meta
            else False
        )
        assert box.take() is None
        wrong = await m.send("cmd/step", Text("two"))
        assert wrong.status is Status.REFUSED
        assert "takes Int" in wrong.detail
        with pytest.raises(NoAnswer, match="no message"):
            await box.next(0.01)


async def test_request_is_answered_or_fails_with_class(tmp_path: Path) -> None:
    def handler(request: Int, meta: Meta) -> Text:
        if request.value < 0:
            raise OutOfRange(f"{request.value}: expected 0 or more")
        if request.value > 9:
            raise ZeroDivisionError("a mistake of the handler")
        return Text(str(request.value))

    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        m.serve("sys/text", Int, handler, reply=Text)
        assert await m.request("sys/text", Int(3), Text) == Text("3")
        with pytest.raises(OutOfRange, match="-1: expected 0 or more"):
            await m.request("sys/text", Int(-1), Text)
        with pytest.raises(Exception, match="ZeroDivisionError: a mistake of the handler"):
            await m.request("sys/text", Int(10), Text)
        with pytest.raises(TypeMismatch, match="takes Int, not Float"):
            await m.request("sys/text", Float(1.0), Text)
        assert await m.request("sys/text", Int(4), Text) == Text("4"), "it goes on"


async def test_request_leaves_at_once_and_reports_reception(
    tmp_path: Path,
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        left: list[Frame] = []
        node.messaging.set_gateway(left.append)
        asked = m.request("/uav7/cmd/step", Int(1), Int, timeout_s=0.05)
        assert [frame.receiver_hw for frame in left] == [THERE]
        with pytest.raises(NoAnswer):
            await asked
        metas: list[Meta] = []

        def take(step: Int, meta: Meta) -> Int:
            metas.append(meta)
            return step

        m.serve("cmd/step", Int, take)
        await m.request("cmd/step", Int(2), Int)
        frame = left[0]
        frame.receiver_hw, frame.sender_hw = node.hardware, THERE
        frame.extension = with_sender(frame.extension, None, 4_000)
        node.messaging.deliver(frame)
        await m.request("cmd/step", Int(3), Int)
        assert [meta.arrived_ns for meta in metas] == [None, 4_000, None]


async def test_request_to_unserved_path_fails_after_grace(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        with pytest.raises(NotFound, match="no application here takes this path and type"):
            await m.request("sys/nothing", Int(1), Text, timeout_s=5.0)


async def test_boards_of_other_platforms_appear_as_mirrors(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        heights = m.readers("/*/nav/height", Float)
        assert len(heights) == 0
        mirror = node.mirror_writer("uav7", "nav/height")
        data_id = names.data_id("nav/height", "Float")
        mirror.publish(encode(Frame(FrameKind.BOARD, data_id, THERE, payload=registry.encode(Float(4.0)))))
        assert await heights.changed(PATIENCE_S) == ("uav7",)
        assert heights["uav7"].value == Float(4.0)
        with pytest.raises(NoAnswer):
            await heights.changed(0.01)
        mirror.close()
        with pytest.raises(InvalidInput, match="wildcards only in the platform"):
            m.readers("/*/nav/*", Float)


async def test_board_waiter_ignores_other_bells(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        heights = m.readers("/*/nav/height", Float)
        mirror = node.mirror_writer("uav7", "nav/height")
        data_id = names.data_id("nav/height", "Float")
        frame = encode(Frame(FrameKind.BOARD, data_id, THERE, payload=registry.encode(Float(4.0))))
        mirror.publish(frame)
        assert await heights.changed(PATIENCE_S) == ("uav7",)
        other = m.writer("nav/other", Float)
        reader = m.reader("nav/other", Float)
        wakeup = heights._wakeup = Counted()
        waiting = asyncio.create_task(heights.changed(PATIENCE_S))
        await asyncio.sleep(0)
        for number in range(3):
            other.write(Float(number))
            await reader.changed(PATIENCE_S)
            heights.poll()
        assert wakeup.count == 0
        mirror.publish(frame)
        assert await waiting == ("uav7",)
        assert wakeup.count == 1
        mirror.close()


async def test_damaged_or_mistyped_frame_is_counted(
    tmp_path: Path,
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        reader = m.reader("/uav7/nav/height", Float)
        mirror = node.mirror_writer("uav7", "nav/height")
        good = Frame(
            FrameKind.BOARD, names.data_id("nav/height", "Float"), THERE, payload=registry.encode(Float(4.0))
        )
        mirror.publish(encode(good))
        assert reader.value == Float(4.0)
        foreign = names.data_id("nav/height", "Int")
        for bad in (
            b"no frame",
            encode(msgspec.structs.replace(good, data_id=foreign)),
            encode(msgspec.structs.replace(good, payload=b"\xc1")),
        ):
            mirror.publish(bad)
            assert reader.value == Float(4.0)
        assert reader.refused == 3
        mirror.close()


async def test_described_type_is_described_again_by_publisher(tmp_path: Path) -> None:
    fields = (FieldDescription("fallen_m", "float"), FieldDescription("of", "str"))
    rain = class_of(TypeDescription((StructDescription("Rain", fields, array=True),)))
    async with tmp_node(tmp_path) as node, Module("station", node=node) as m:
        m.writer("sensor/rain", rain)
        m.writer("sensor/height", Float)
        await asyncio.sleep(0)
        assert list(m.entry.types) == ["Rain"], "a type of every node needs no description"


async def test_module_of_another_user_serves_only_own_paths(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def answer(request: Int, meta: Meta) -> Int:
        return request

    monkeypatch.setattr(AppFile, "is_foreign", True)
    async with tmp_node(tmp_path) as node, Module("survey", node=node) as m:
        for path in ("sys/tree/set", "cmd/goto", "/uav1/cmd/goto"):
            with pytest.raises(
                Denied, match=r"served by the user of the node alone; expected a path outside"
            ):
                m.serve(path, Int, answer)
            with pytest.raises(Denied):
                m.inbox(path, Int)
        m.serve("survey/start", Int, answer)
        assert await m.request("survey/start", Int(3), Int) == Int(3)
