"""share/doc/types.md is enough to read and write a payload: what is coded by its tables is what we read."""

import math
import re
import struct
from pathlib import Path

import msgspec
import pytest

from swarmware.model.frame import Codec
from swarmware.model.platform_kind import PlatformKind
from swarmware.types import registry
from swarmware.types.mission import PHASES, Arrival, BarrierResult, MissionPhase, MissionState
from swarmware.types.vehicle import Pose

PAGE = (Path(__file__).parents[2] / "share" / "doc" / "types.md").read_text("utf-8")
WIRE = {"u8": "B", "i16": "h", "u16": "H", "i32": "i", "u32": "I"}


def form(title: str) -> dict[str, tuple[int, str]]:
    """The rows of a quantised form: name → offset and type."""
    table = PAGE.split(f"Quantised form of {title}", 1)[1].split("\n\n")[1]
    rows = re.findall(r"^\| (\d+) \| (\w+) \| (\w+) \|", table, re.M)
    return {name: (int(at), wire) for at, name, wire in rows}


def coded(title: str, values: dict[str, int]) -> bytes:
    """Bytes of these numbers in the layout of the form."""
    rows = form(title)
    assert rows.keys() == values.keys()
    out = bytearray()
    for name, (at, wire) in rows.items():
        assert at == len(out), "without gaps"
        if wire == "i24":
            out += values[name].to_bytes(3, "little", signed=True)
        else:
            out += struct.pack("<" + WIRE[wire], values[name])
    return bytes(out)


def level(yaw_rad: float) -> int:
    """A level attitude as the protocol says: the largest component by number, the others in 15 bits each."""
    z, w = math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)
    packed = 3
    for part in (0.0, 0.0, z if w > 0 else -z):
        packed = packed << 15 | round(16384 + math.sqrt(2) * 16383 * part)
    return packed


@pytest.mark.parametrize(("title", "x_mm"), [("Pose, 23 bytes", 8_388_607), ("Pose, 26 bytes", -9_000_000)])
def test_pose_coded_by_table_of_page_is_pose(title: str, x_mm: int) -> None:
    attitude = level(0.5)
    numbers = {"x": x_mm, "y": -2000, "z": 1500, "vx": 125, "vy": -250, "vz": 50, "wz": -300}
    data = coded(title, {**numbers, "attitude_high": attitude >> 32, "attitude_low": attitude & 0xFFFF_FFFF})
    pose = registry.decode(Pose, data, Codec.PACKED)
    assert (pose.x_m, pose.y_m, pose.z_m) == (x_mm / 1000, -2.0, 1.5)
    assert (pose.vx_m_s, pose.vy_m_s, pose.vz_m_s, pose.wz_rad_s) == (1.25, -2.5, 0.5, -0.3)
    assert pose.yaw_rad == pytest.approx(0.5, abs=1e-3)
    assert pose.pack() == data


def test_mission_state_coded_by_page_is_state() -> None:
    head = coded(
        "MissionState",
        {
            "epoch": 77,
            "hash": 0x0BADCAFE,
            "state": PHASES.index(MissionPhase.RUNNING),
            "kind": 1,
            "progress": 51,
        },
    )
    rest = msgspec.msgpack.encode([["a"], [["gate", 1]], [["@start", 1, 5, 0]], "flying", "formation"])
    state = registry.decode(MissionState, head + rest, Codec.PACKED)
    assert state == MissionState(
        77,
        "0badcafe",
        MissionPhase.RUNNING,
        ("a",),
        (Arrival("gate", 1),),
        (BarrierResult("@start", 1, 5, 0),),
        0.2,
        "flying",
        "formation",
        PlatformKind.UAV,
    )
    assert state.pack() == head + rest


def test_page_says_array_or_map_per_type() -> None:
    told = dict(re.findall(r"^### (\w+)\n\n.*\((array|map)", PAGE, re.M))
    for name, layout in told.items():
        cls = registry.find(name) if name not in {"Resource", "Changes", "AppEntry", "Served"} else None
        if cls is not None:
            assert cls.__struct_config__.array_like is (layout == "array"), name
    assert len(told) > 100


def test_array_without_defaults_or_with_more_reads() -> None:
    assert registry.decode(Pose, msgspec.msgpack.encode([1.0, 2])) == Pose(1.0, 2.0)
    longer = [1.0, 2.0, 3.0, 0, 0, 0, 1, 0, 0, 0, 0, "new", {"newer": 1}]
    assert registry.decode(Pose, msgspec.msgpack.encode(longer)) == Pose(1.0, 2.0, 3.0)
