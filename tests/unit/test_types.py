"""Payload types: names, MessagePack, packed forms, and bytes that are none of it."""

import contextlib
import math
import subprocess
import sys
import tracemalloc
import zlib

import msgspec
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import InvalidInput, NotFound, OutOfRange, WireError
from swarmware.model.frame import PAYLOAD_LIMIT, Codec
from swarmware.types import registry
from swarmware.types.scalar import Float, Int, Text
from swarmware.types.vehicle import BatteryState, Pose

METRES = st.floats(-2e6, 2e6)
SPEED = st.floats(-300, 300)
POSES = st.builds(
    lambda x, y, z, yaw, v: Pose.planar(x, y, z, yaw, (v, -v, 0.0), 0.5),
    METRES,
    METRES,
    METRES,
    st.floats(-3.1, 3.1),
    SPEED,
)


@given(POSES)
def test_packed_pose_is_true_to_half_millimetre(pose: Pose) -> None:
    data, codec = registry.pack(pose)
    assert codec is Codec.PACKED
    assert len(data) < len(registry.encode(pose)) / 2
    back = registry.decode(Pose, data, codec)
    assert math.dist((pose.x_m, pose.y_m, pose.z_m), (back.x_m, back.y_m, back.z_m)) < 1e-3
    assert abs(pose.vx_m_s - back.vx_m_s) <= 0.00501
    assert abs(math.remainder(pose.yaw_rad - back.yaw_rad, math.tau)) < 1e-3


@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: math.hypot(*q) > 0.01))
def test_a_packed_attitude_is_the_same_rotation(q: tuple[float, float, float, float]) -> None:
    unit = [part / math.hypot(*q) for part in q]
    back = Pose.unpack(Pose(0.0, 0.0, 0.0, *unit).pack())
    dot = abs(sum(a * b for a, b in zip(unit, (back.qx, back.qy, back.qz, back.qw), strict=True)))
    assert 2 * math.acos(min(1.0, dot)) < 3e-4, "rad between the two"


def test_near_pose_takes_23_bytes_far_26() -> None:
    assert len(Pose.planar(8300.0, -8300.0, 8300.0).pack()) == 23
    assert len(Pose.planar(8400.0, 0.0, 0.0).pack()) == 26


@pytest.mark.parametrize("q", [(0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0)])
def test_invalid_rotation_travels_unchanged(q: tuple[float, float, float, float]) -> None:
    data, codec = registry.pack(Pose(1.0, 2.0, 3.0, *q))
    assert codec is Codec.NONE
    back = registry.decode(Pose, data, codec)
    assert str((back.qx, back.qy, back.qz, back.qw)) == str(q)


def test_values_beyond_packed_range_are_clipped_to_it() -> None:
    back = Pose.unpack(Pose(1e9, -1e9, vx_m_s=1e6).pack())
    assert back.x_m == pytest.approx(2147483.647)
    assert back.vx_m_s == pytest.approx(327.67)


@given(st.sampled_from([Pose, BatteryState, Float, Text]), st.binary(max_size=80), st.sampled_from(Codec))
def test_any_bytes_give_value_or_wire_error(cls: type[msgspec.Struct], data: bytes, codec: Codec) -> None:
    with contextlib.suppress(WireError):
        registry.decode(cls, data, codec)


def test_unfitting_field_is_named_by_path() -> None:
    data = msgspec.msgpack.encode([12.0, "much", 0.5])
    with pytest.raises(WireError, match=r"BatteryState.*\$\[1\]"):
        registry.decode(BatteryState, data)


def test_compressed_payload_is_read_and_bomb_is_refused() -> None:
    data = zlib.compress(registry.encode(Text("a" * 1000)))
    assert registry.decode(Text, data, Codec.ZLIB) == Text("a" * 1000)
    with pytest.raises(WireError, match="zlib"):
        registry.decode(Text, zlib.compress(bytes(PAYLOAD_LIMIT + 1)), Codec.ZLIB)


def test_type_is_found_by_name_before_import() -> None:
    fresh = (
        "import sys; from swarmware.types import registry;"
        " assert 'swarmware.types.vehicle' not in sys.modules; print(registry.find('Pose').__module__)"
    )
    done = subprocess.run([sys.executable, "-c", fresh], capture_output=True, text=True, check=False)
    assert done.stdout == "swarmware.types.vehicle\n", done.stderr
    assert registry.find("Pose") is Pose
    with pytest.raises(NotFound, match=r"'Pse'.*Pose"):
        registry.find("Pse")


def test_type_that_is_unknown_is_searched_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not registry.installed("Pse")
    imported: list[str] = []
    monkeypatch.setattr(registry, "import_module", imported.append)
    assert not registry.installed("Pse") and not registry.installed("Psf")
    assert not imported, "a log may have a million values of such a type"


def test_two_types_of_one_name_are_refused() -> None:
    with pytest.raises(InvalidInput, match="belongs to"):
        registry.register(msgspec.defstruct("Pose", [("x", int)], module="elsewhere"))


@pytest.mark.parametrize("stated", [True, False])
def test_zstd_bomb_takes_frame_size_at_most(stated: bool) -> None:
    bomb = _zstd(bytes(286 * 2**20) if not stated else bytes(16 * 2**20), stated)
    assert len(bomb) < 30_000
    tracemalloc.start()
    try:
        with pytest.raises(WireError, match="zstd"):
            registry.decompress(bomb, Codec.ZSTD)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 4 * PAYLOAD_LIMIT


def _zstd(data: bytes, stated: bool) -> bytes:
    return zstandard.ZstdCompressor(write_content_size=stated).compress(data)


@given(st.binary(min_size=1, max_size=3000), st.booleans())
def test_zstd_payload_round_trips_and_truncated_is_refused(data: bytes, stated: bool) -> None:
    packed = _zstd(data, stated)
    assert registry.decompress(packed, Codec.ZSTD) == data
    for cut in range(0, len(packed), max(1, len(packed) // 7)):
        with pytest.raises(WireError, match="zstd"):
            registry.decompress(packed[:cut], Codec.ZSTD)


@pytest.mark.parametrize("codec", [Codec.NONE, Codec.ZLIB, Codec.ZSTD])
def test_payload_of_unknown_type_is_messagepack(codec: Codec) -> None:
    plain = registry.encode(Pose(1.0, 2.0))
    data = {Codec.NONE: plain, Codec.ZLIB: zlib.compress(plain), Codec.ZSTD: _zstd(plain, stated=True)}
    assert registry.messagepack("TypeOfTheUser", data[codec], codec) == plain
    with pytest.raises(NotFound):
        registry.messagepack("TypeOfTheUser", *registry.pack(Pose(1.0, 2.0)))


@pytest.mark.parametrize("number", [math.nan, math.inf, 1e308])
def test_unpackable_value_goes_as_messagepack(
    number: float,
) -> None:
    data, codec = registry.pack(Pose(number, 0.0))
    assert codec is Codec.NONE
    with pytest.raises(WireError, match=r"Pose.*\$\[0\]"):
        registry.decode(Pose, data, codec)


def test_integer_beyond_64_bits_is_refused() -> None:
    with pytest.raises(OutOfRange, match="Int"):
        registry.encode(Int(2**64))
