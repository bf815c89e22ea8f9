"""Compression of payloads: its text, filters that are reverted bit for bit, containers of unknown origin."""

import struct
import tracemalloc
import zlib
from pathlib import Path

import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import InvalidInput, WireError
from swarmware.model.compression import Compression, Method, needs, pack, unpack
from swarmware.model.frame import PAYLOAD_LIMIT
from swarmware.model.record_filter import (
    NO_RECORDS,
    VLP16_PACKET,
    Layout,
    Records,
    apply,
    revert,
    vlp16_records,
)

RECORDING = (Path(__file__).parents[2] / "share/swarm/data/vlp16/recording.bin").read_bytes()
ZLIB = Compression.parse("zlib:1")
ZSTD = Compression.parse("zstd:1")
HEADER = struct.Struct("<BBBBIIH")


@pytest.mark.parametrize(
    ("text", "method", "level"),
    [
        ("none", Method.NONE, 0),
        ("zlib", Method.ZLIB, 6),
        ("zlib:9", Method.ZLIB, 9),
        ("zstd:19", Method.ZSTD, 19),
        ("jpeg", Method.JPEG, 80),
        ("auto", Method.AUTO, 0),
    ],
)
def test_compression_is_method_with_or_without_its_level(text: str, method: Method, level: int) -> None:
    found = Compression.parse(text)
    assert (found.method, found.level) == (method, level)
    assert Compression.parse(str(found)) == found


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("gzip", "expected one of none, zlib, zstd, jpeg, h264, auto"),
        ("zlib:0", "expected zlib:1 to zlib:9"),
        ("zlib:", "expected zlib:1 to zlib:9"),
        ("zstd:20", "expected zstd:1 to zstd:19"),
        ("jpeg:96", "expected jpeg:1 to jpeg:95"),
        ("auto:3", "expected auto without a level"),
        ("h264:3", "without a level"),
    ],
)
def test_other_text_is_refused_with_expectation(text: str, reason: str) -> None:
    with pytest.raises(InvalidInput, match=reason):
        Compression.parse(text)


@pytest.mark.parametrize("packets", [1, 2, 26, 76])
@pytest.mark.parametrize("head", [0, 4])
def test_packets_of_lidar_come_back_bit_for_bit(packets: int, head: int) -> None:
    size = VLP16_PACKET + head
    data = b"before" + b"".join(
        bytes(head) + RECORDING[at * VLP16_PACKET : (at + 1) * VLP16_PACKET] for at in range(packets)
    )
    records = Records(Layout.VLP16, size, size * packets)
    assert apply(data, records) != data
    assert revert(apply(data, records), records) == data


@given(st.binary(max_size=4), st.integers(0, 3), st.data())
def test_any_bytes_of_size_of_packets_come_back(before: bytes, packets: int, data: st.DataObject) -> None:
    payload = before + data.draw(st.binary(min_size=packets * 1206, max_size=packets * 1206))
    records = Records(Layout.VLP16, 1206, packets * 1206)
    assert revert(apply(payload, records), records) == payload


@given(st.binary(max_size=300), st.integers(1, 40))
def test_any_records_come_back_also_with_a_rest(payload: bytes, record_bytes: int) -> None:
    records = Records(Layout.RECORDS, record_bytes, len(payload))
    assert revert(apply(payload, records), records) == payload


def test_lidar_turn_shrinks_to_third_packet_half() -> None:
    turn = RECORDING[: 76 * VLP16_PACKET]
    for compression in (ZLIB, ZSTD):
        packed = pack(turn, compression, vlp16_records(turn))
        assert unpack(packed) == turn
        assert len(packed) < 0.35 * len(turn)
        without = pack(turn, compression)
        assert len(without) > 0.5 * len(turn)
    packet = RECORDING[:VLP16_PACKET]
    assert len(pack(packet, ZSTD, vlp16_records(packet))) < 0.5 * len(packet)


def test_only_packets_of_vlp16_are_taken_for_them() -> None:
    packet = RECORDING[:VLP16_PACKET]
    assert vlp16_records(packet).layout is Layout.VLP16
    for other in (b"", packet[:-1], packet[1:] + b"\0"):
        assert vlp16_records(other) == NO_RECORDS


@given(st.binary(min_size=1, max_size=3000), st.sampled_from(["zlib:1", "zlib:9", "zstd:1", "zstd:19"]))
def test_payload_round_trips_and_truncated_is_refused(payload: bytes, method: str) -> None:
    packed = pack(payload, Compression.parse(method))
    assert unpack(packed) == payload
    for cut in range(0, len(packed), max(1, len(packed) // 7)):
        with pytest.raises(WireError):
            unpack(packed[:cut])


@given(st.binary(max_size=200))
def test_garbage_is_refused_with_error_of_wire(data: bytes) -> None:
    with pytest.raises(WireError):
        unpack(data)


@given(
    st.tuples(
        st.integers(0, 3), st.integers(0, 3), st.integers(0, 4), st.just(0), st.integers(0, 2**32 - 1),
        st.integers(0, 2**32 - 1), st.integers(0, 0xFFFF)
    ),
    st.sampled_from([zlib.compress(bytes(3000)), zstandard.compress(bytes(3000)), b""]),
)  # fmt: skip
def test_header_unlike_its_data_is_refused(header: tuple[int, ...], body: bytes) -> None:
    try:
        assert len(unpack(HEADER.pack(*header) + body)) == 3000
    except WireError:
        pass
    else:
        assert header[0] == 1
        assert header[4] == 3000


@pytest.mark.parametrize(
    ("header", "reason"),
    [
        ((2, 1, 0, 0, 3000, 0, 0), "version 2: expected 1"),
        ((1, 3, 0, 0, 3000, 0, 0), "method 3"),
        ((1, 1, 9, 0, 3000, 0, 0), "layout 9"),
        ((1, 1, 0, 0, PAYLOAD_LIMIT + 1, 0, 0), "expected at most"),
        ((1, 1, 0, 0, 2999, 0, 0), "more than 2999"),
        ((1, 1, 0, 0, 3001, 0, 0), "it states 3001"),
        ((1, 1, 1, 0, 3000, 3001, 32), "3001 in all"),
        ((1, 1, 2, 0, 3000, 2400, 1200), "expected 1206"),
        ((1, 1, 1, 0, 3000, 3000, 0), "records of 0 bytes"),
    ],
)
def test_each_wrong_field_of_a_header_is_named(header: tuple[int, ...], reason: str) -> None:
    with pytest.raises(WireError, match=reason):
        unpack(HEADER.pack(*header) + zlib.compress(bytes(3000)))


@pytest.mark.parametrize(
    "bomb",
    [
        HEADER.pack(1, 1, 0, 0, 1000, 0, 0) + zlib.compress(bytes(64 * 2**20)),
        HEADER.pack(1, 2, 0, 0, 1000, 0, 0) + zstandard.compress(bytes(64 * 2**20)),
        HEADER.pack(1, 2, 0, 0, 1000, 0, 0)
        + zstandard.ZstdCompressor(write_content_size=False).compress(bytes(64 * 2**20)),
    ],
    ids=["zlib", "zstd", "zstd without a size"],
)
def test_bomb_takes_stated_memory_at_most(bomb: bytes) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(WireError):
            unpack(bomb)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1_000_000


def test_receiver_must_read_method_and_layout() -> None:
    assert needs(ZLIB) == {"zlib"}
    assert needs(ZSTD, Records(Layout.VLP16, 1206, 1206)) == {"zstd", "vlp16"}
