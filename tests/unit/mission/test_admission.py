"""May an order be played here? What is refused, and with which words."""

import asyncio
import contextlib
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.mission.nets import net

from swarmd.mission.checking import Checker
from swarmd.mission.core.admission import OrderAdmission
from swarmd.mission.core.run import Run
from swarmware.errors import MissionError, WireError
from swarmware.mission.catalogue import built_in
from swarmware.mission.model import content_hash
from swarmware.model.platform_kind import PlatformKind
from swarmware.types import registry
from swarmware.types.mission import Arrival, BarrierResult, Member, MissionOrder, MissionPhase, MissionState

TEXT = net(
    s="Start>a",
    a="Arm>t",
    t={"type": "Takeoff", "alt": "$param.height", "next": "e"},
    e="End",
).replace('{"mission"', '{"params": {"height": 5.0}, "mission"', 1)
S = 1_000_000_000
STATE = MissionState(
    4_000_000_000,
    "00ab12cd",
    MissionPhase.RUNNING,
    ("advance",),
    (Arrival("course", 1),),
    (BarrierResult("formed", 1, -5_000_000_000, 0), BarrierResult("airborne", 1, None, 2)),
    0.5,
    "advance: 0.1 m off its slot",
    "formation",
    PlatformKind.UAV,
)


def order(text: str = TEXT, **changed: object) -> MissionOrder:
    plain = MissionOrder(
        mission="hop",
        hash="00" * 16,
        epoch=7,
        role="air",
        file="hop/air.json",
        text=text,
        text_hash=content_hash(text),
        members=(Member("uav1", "air", PlatformKind.UAV), Member("uav2", "air", PlatformKind.UAV)),
        params={"height": 8.0},
        issuer="gcs",
        issued_ns=0,
        expires_ns=10 * S,
    )
    return msgspec.structs.replace(plain, **changed)


def admit(order: MissionOrder, now_ns: int = S, kind: str = "uav") -> Run:
    """The order as the daemon takes it."""
    desk = OrderAdmission("uav1", PlatformKind(kind))
    binding = desk.verify(order, now_ns, 10 * S)
    checker = Checker(built_in())
    return desk.run(order, asyncio.run(checker.load(order.text, order.file, binding)))


def test_good_order_becomes_run_with_its_parameters() -> None:
    run = admit(order())
    assert run.mission.blocks["t"].params.altitude_m == 8.0  # type: ignore[attr-defined]  # Takeoff's
    assert (run.name, run.epoch, run.role) == ("hop", 7, "air")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"text_hash": "0"}, "hash differs"),
        ({"text_hash": content_hash(TEXT + " ")}, "hash differs"),
        ({"members": (Member("uav2", "air", PlatformKind.UAV),)}, "uav1 is not among its members"),
        ({"members": (Member("uav1", "air", PlatformKind.UAV),) * 2}, "is listed twice"),
        ({"params": {"height": "high"}}, "/params/height"),
        ({"params": {"height": -3.0}}, "/mission/t/alt"),
    ],
)
def test_an_order_that_does_not_fit_is_refused(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(MissionError) as caught:
        admit(order(**changed))
    assert words in str(caught.value)


def test_an_order_that_came_too_late_is_refused() -> None:
    with pytest.raises(MissionError, match=r"arrived 2\.0 s after its expiry"):
        admit(order(), 12 * S)


@pytest.mark.parametrize("sender", ["uav2", "uav1", "gcs2"])
def test_order_in_name_of_another_platform_is_refused(sender: str) -> None:
    with pytest.raises(
        MissionError, match=f"order of gcs: sent by {sender}; expected it from its issuer itself"
    ):
        OrderAdmission("uav1", PlatformKind.UAV).verify(order(), S, 10 * S, sender)
    OrderAdmission("uav1", PlatformKind.UAV).verify(order(), S, 10 * S, "gcs")


def test_an_unsound_mission_is_refused_with_the_place() -> None:
    text = net(s="Start>t", t={"type": "Arm", "next": "e"}, e="End", x={"type": "Arm", "next": "e"})
    with pytest.raises(MissionError, match=r"hop/air\.json:1: /mission/x: 'x' can never be reached"):
        admit(order(text))


def test_mission_that_this_vehicle_cannot_do_is_refused() -> None:
    with pytest.raises(MissionError, match="a ugv cannot Takeoff: expected uav"):
        admit(order(), kind="ugv")


@given(st.binary(max_size=200) | st.builds(lambda cut: registry.encode(order())[:cut], st.integers(0, 400)))
def test_any_bytes_are_order_state_or_error(data: bytes) -> None:
    for cls in (MissionOrder, MissionState):
        try:
            registry.decode(cls, data)
        except WireError:
            continue


@given(st.binary(max_size=100) | st.builds(lambda cut: STATE.pack()[:cut], st.integers(0, 200)))
def test_any_bytes_are_packed_state_or_wire_error(data: bytes) -> None:
    with contextlib.suppress(WireError):
        MissionState.unpack(data).pack()


def test_a_state_is_the_same_after_the_beacon() -> None:
    packed = STATE.pack()
    assert len(packed) + 20 < len(registry.encode(STATE))
    back = MissionState.unpack(memoryview(packed))
    assert msgspec.structs.replace(back, progress_ratio=0.5) == STATE
    assert back.progress_ratio == pytest.approx(0.5, abs=0.002)
    idle = MissionState(0, "", MissionPhase.IDLE, kind=PlatformKind.GCS)
    assert MissionState.unpack(idle.pack()) == idle


def test_an_order_is_the_same_after_the_wire() -> None:
    sent = order(
        params={"height": 8.0, "course": ((0.0, 1.0), (2.0, 3.0)), "slot": 3, "on": True, "who": "a"}
    )
    assert registry.decode(MissionOrder, registry.encode(sent)) == sent


def test_drained_platform_refuses_orders_naming_operator() -> None:
    with pytest.raises(MissionError, match=r"drained by ann@gcs; `swarmctl node undrain` ends it"):
        OrderAdmission("uav1", PlatformKind.UAV).verify(order(), S, 10 * S, "gcs", "ann@gcs")


def test_beacon_names_drainer_only_when_drained() -> None:
    drained = msgspec.structs.replace(STATE, drained_by="ann@gcs")
    assert len(drained.pack()) == len(STATE.pack()) + len("ann@gcs") + 1
    assert MissionState.unpack(drained.pack()).drained_by == "ann@gcs"
    assert MissionState.unpack(STATE.pack()).drained_by == ""
