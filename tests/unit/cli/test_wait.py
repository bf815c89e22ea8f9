"""`swarmctl wait`: when a condition on resources counts as reached, and what is refused."""

import asyncio
import re
from collections.abc import AsyncIterator
from typing import Any

import msgspec
import pytest
from tests.unit.cli.session import COPY, GET, LIST, ScriptedSession

from swarmctl.commands.wait.condition_watch import ConditionWatch
from swarmctl.commands.wait.waiting import wait_until
from swarmware.errors import InvalidInput, MissionError, NoAnswer, NotFound, SwarmError
from swarmware.model.frame import Frame, FrameKind
from swarmware.model.resource import Kind
from swarmware.testing.client import FakeClient
from swarmware.types import registry
from swarmware.types.described import class_of
from swarmware.types.description import FieldDescription, StructDescription, TypeDescription
from swarmware.types.scalar import Float, Text
from swarmware.types.tree import Quality, TreeEntry, TreeList, TreeListing, TreeValue
from swarmware.types.vehicle import BatteryState, Pose, VehicleState

POSE = "/uav1/nav/pose"
STATE = "/uav1/vehicle/state"
BATTERY = "/uav1/power/battery"
S_NS = 1_000_000_000


def known(watch: ConditionWatch, path: str, cls: type[msgspec.Struct], kind: Kind = Kind.BOARD) -> None:
    watch.on_entry(TreeEntry(path, kind, cls.__name__), cls)


# -- the decision


@pytest.mark.parametrize(
    ("text", "held"),
    [
        ("z_m < -2", True),
        ("z_m < -2 and age() < 1", True),
        ("z_m < -2 and age() > 1", False),
        ("/uav1/nav/pose.z_m < -2", True),
        ("nav/pose.z_m < -2", True),
        ("not (x_m > 0)", True),
        ("yaw_rad > 1", True),
        ("power/battery.remaining_ratio < 30 %", True),
        ("power/battery.remaining_ratio < 30 % and age(power/battery) > 1", True),
        ("/uav2/nav/pose.x_m > 0", False),
    ],
)
def test_names_without_path_are_fields_of_resource(text: str, held: bool) -> None:
    watch = ConditionWatch(POSE, text)
    known(watch, POSE, Pose)
    known(watch, BATTERY, BatteryState)
    watch.on_value(POSE, Pose.planar(-1.0, 0.0, yaw_rad=1.5), 9 * S_NS)
    watch.on_value(POSE, msgspec.structs.replace(Pose.planar(-1.0, 0.0, yaw_rad=1.5), z_m=-3.0), 10 * S_NS)
    watch.on_value(BATTERY, BatteryState(11.0, 1.0, 0.25), 8 * S_NS)
    assert watch.holds(10 * S_NS + 5) is held


def test_texts_are_in_single_or_double_quotes() -> None:
    for text in ("mode == 'auto'", 'mode == "auto"'):
        watch = ConditionWatch(STATE, text)
        known(watch, STATE, VehicleState)
        watch.on_value(STATE, VehicleState(True, False), 0)
        assert watch.holds(0)


def test_condition_fails_until_all_values_exist() -> None:
    watch = ConditionWatch(POSE, "z_m < 1 and vehicle/state.armed")
    assert watch.paths == {POSE, STATE}
    known(watch, POSE, Pose)
    watch.on_value(POSE, Pose.planar(0.0, 0.0), 0)
    assert not watch.holds(0)
    known(watch, STATE, VehicleState)
    watch.on_value(STATE, VehicleState(True, False), 0)
    assert watch.holds(0)
    assert watch.shown(watch.operands(S_NS)) == "z_m 0 (1.0 s old), armed true (1.0 s old)"


def test_next_evaluation_is_when_age_expires() -> None:
    watch = ConditionWatch(POSE, "age() > 2 or 5 < age()")
    assert watch.next_change_s(0) is None, "without a value only a value changes it"
    watch.on_value(POSE, Pose.planar(0.0, 0.0), 10 * S_NS)
    assert watch.next_change_s(11 * S_NS) == pytest.approx(1.0, abs=0.01)
    assert watch.next_change_s(13 * S_NS) == pytest.approx(2.0, abs=0.01)
    assert watch.next_change_s(16 * S_NS) is None
    assert ConditionWatch(POSE, "z_m > 2").next_change_s(0) is None


@pytest.mark.parametrize(
    ("text", "error", "said"),
    [
        ("z_m <", MissionError, "at its end, column 6: expected a number"),
        ("z_m ~ 3", MissionError, "at '~ 3', column 5: expected"),
        ("z_m < 3 z", MissionError, "at 'z', column 9: expected and, or, or the end"),
        ("Nav/pose > 3", MissionError, "at 'Nav/pose', column 1: expected a resource path"),
        ("", MissionError, "at its end, column 1"),
        (
            "x_m > 1 and zm < 3",
            InvalidInput,
            "column 13 of condition 'x_m > 1 and zm < 3': Pose has no field 'zm'",
        ),
        ("z < 3", InvalidInput, "did you mean 'z_m'? (x_m, y_m, z_m"),
        ("z_m == 'high'", InvalidInput, "column 1 .*z_m is a number, 'high' is a text: expected the same"),
        ("z_m", InvalidInput, "is a number: expected a comparison"),
    ],
)
def test_invalid_condition_is_refused_with_column(text: str, error: type[SwarmError], said: str) -> None:
    with pytest.raises(error) as caught:
        known(ConditionWatch(POSE, text), POSE, Pose)
    before, _, after = said.partition(".*")
    assert before in str(caught.value)
    assert after in str(caught.value)


def test_impossible_text_is_refused_with_possible_ones() -> None:
    entry = TreeEntry("/uav1/m", Kind.SETTING, "Text", choices=("auto", "manual"))
    with pytest.raises(InvalidInput, match="never 'off': expected one of 'auto', 'manual'"):
        ConditionWatch("/uav1/m", "value == 'off'").on_entry(entry, Text)


def test_fields_of_a_described_type_are_known() -> None:
    fields = (FieldDescription("fallen_m", "float"), FieldDescription("of", "'rain' | 'hail'"))
    rain = class_of(TypeDescription((StructDescription("Rain", fields, array=True),)))
    watch = ConditionWatch("/uav1/rain", "of == 'hail' and fallen_m > 1")
    known(watch, "/uav1/rain", rain, Kind.EVENT)
    watch.on_value("/uav1/rain", msgspec.convert([2.0, "hail"], rain), 0)
    assert watch.holds(0)
    with pytest.raises(InvalidInput, match="Rain has no field 'fell'"):
        known(ConditionWatch("/uav1/rain", "fell > 1"), "/uav1/rain", rain)


# -- the wait


class FrameClient(FakeClient):
    """A client whose readers give the frames of a session's script."""

    def __init__(self, session: "Waiting") -> None:
        super().__init__()
        self.session = session

    def frame_reader(self, path: str, *, every: bool = False, history: bool = False) -> Any:
        return self.session.frames_of_script()


class Waiting(ScriptedSession):
    """A session whose readers give the frames of a script; the resource may appear with the first one."""

    def __init__(self, entry: TreeEntry | None, present: Any, **options: Any) -> None:
        super().__init__({}, FrameClient(self), **options)
        self.entry = entry
        self.present = present
        self.frames: asyncio.Queue[tuple[msgspec.Struct, TreeEntry | None]] = asyncio.Queue()
        self.reading = asyncio.Event()

    async def ask(self, path: str, value: msgspec.Struct, reply: type[Any], **more: Any) -> Any:
        if path in {LIST, "/uav1/sys/tree/list"}:
            assert isinstance(value, TreeList)
            found = self.entry is not None and self.entry.path.endswith(value.pattern)
            return TreeListing((self.entry,) if found and self.entry else ())
        assert path in {COPY, GET}
        if isinstance(self.present, SwarmError):
            raise self.present
        return self.present

    async def in_reach(self, platform: str) -> bool:
        return True

    async def frames_of_script(self) -> AsyncIterator[Frame]:
        while True:
            self.reading.set()
            value, appearing = await self.frames.get()
            self.entry = appearing or self.entry
            data = registry.encode(value)
            yield Frame(
                FrameKind.BOARD, 1, self.module.node.hardware, 1, 0, 0, 1, self.module.now_ns(), payload=data
            )


def present(number: float, quality: Quality = Quality.LIVE) -> TreeValue:
    return TreeValue("/uav1/height", "Float", registry.encode(Float(number)), 1, 1, 1, 0.1, quality)


HEIGHT = TreeEntry("/uav1/height", Kind.BOARD, "Float", unit="m")


async def test_condition_that_holds_already_is_reached_at_once() -> None:
    session = Waiting(HEIGHT, present(3.0), output="json")
    await wait_until(session, "/uav1/height", "value > 2", 60.0)
    (operand,) = session.document["operands"]
    assert (operand["path"], operand["field"], operand["value"]) == ("/uav1/height", "value", 3.0)
    assert session.document["condition"] == "value > 2"


async def test_each_value_is_evaluated_on_arrival() -> None:
    session = Waiting(HEIGHT, present(0.0))
    task = asyncio.create_task(wait_until(session, "/uav1/height", "value > 2", 60.0))
    await session.reading.wait()
    for number in (1.0, 3.0, 0.5):
        session.frames.put_nowait((Float(number), None))
    await task
    assert session.stdout.getvalue().startswith("/uav1/height: value 3 (0.0 s old) after ")


async def test_resource_not_yet_existing_is_awaited() -> None:
    session = Waiting(None, NotFound("no such resource"))
    task = asyncio.create_task(wait_until(session, "/uav1/height", "value > 2", 60.0))
    await session.reading.wait()
    session.frames.put_nowait((Float(3.0), HEIGHT))
    await task
    assert "does not exist yet; waiting for it" in session.stderr.getvalue()
    assert session.stdout.getvalue().startswith("/uav1/height: value 3")


async def test_age_of_value_ends_wait_without_new_one() -> None:
    session = Waiting(HEIGHT, present(3.0))
    await wait_until(session, "/uav1/height", "age() > 0.15", 60.0)
    assert re.match(r"/uav1/height: age\(\) 0\.\d{3} s after ", session.stdout.getvalue())


async def test_last_value_is_in_timeout_error() -> None:
    session = Waiting(HEIGHT, present(0.5))
    with pytest.raises(
        NoAnswer, match=r"/uav1/height: value > 2: not within 0.05 s; last: value 0.5 \(0.* old\)"
    ):
        await wait_until(session, "/uav1/height", "value > 2", 0.05)
    with pytest.raises(NoAnswer, match="last: value has no value"):
        await wait_until(Waiting(None, NotFound("no")), "/uav1/height", "value > 2", 0.05)
    assert session.stdout.getvalue() == ""


async def test_lost_platforms_last_value_does_not_count() -> None:
    session = Waiting(HEIGHT, present(3.0, Quality.LOST))
    with pytest.raises(NoAnswer, match="has no value"):
        await wait_until(session, "/uav1/height", "value > 2", 0.05)
    assert "lost; waiting for a new value" in session.stderr.getvalue()
    event = msgspec.structs.replace(HEIGHT, kind=Kind.EVENT)
    with pytest.raises(NoAnswer, match="has no value"):
        await wait_until(Waiting(event, present(3.0)), "/uav1/height", "value > 2", 0.05)


async def test_unknown_field_ends_wait_before_any_value() -> None:
    with pytest.raises(InvalidInput, match="Float has no field 'z'; expected one of these"):
        await wait_until(Waiting(HEIGHT, NotFound("no value yet")), "/uav1/height", "z > 2", 60.0)
