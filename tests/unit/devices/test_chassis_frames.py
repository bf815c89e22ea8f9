"""Frames of a serial chassis: another implementation reads them; damaged ones are refused."""

import math
import re
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.devices.chassis_frames import (
    FRAME_BYTES,
    GAINS_LIMIT,
    Telemetry,
    command,
    frame_decoder,
    framed,
    order_frame,
    report_frame,
    setpoint_frame,
    telemetry,
)
from swarmware.devices.serial_frames import FrameDecoder, cobs, cobs_bytes, crc32, serial_frame, uncobs
from swarmware.errors import InvalidInput, WireError
from swarmware.types import registry
from swarmware.types.chassis import ChassisAction, ChassisOrder, ChassisReport
from swarmware.types.vehicle import BatteryState, Setpoint

PAGE = Path(__file__).parents[3] / "share/doc/reference/chassis-protocol.md"


def crc16(data: bytes) -> int:
    """The CRC of the page, bit by bit."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def encoded(body: bytes) -> bytes:
    """A frame as the page states it, written from the page alone."""
    data = body + struct.pack("<H", crc16(body)) + b"\0"
    out, at = bytearray(), 0
    while at < len(data):
        end = data.index(0, at)
        out += bytes([end - at + 1]) + data[at:end]
        at = end + 1
    return bytes(out) + b"\0"


def decoded(frame: bytes) -> bytes | None:
    """The body of a frame, read by the page alone."""
    out, at = bytearray(), 0
    while at < len(frame):
        if frame[at] == 0 or at + frame[at] > len(frame):
            return None
        out += frame[at + 1 : at + frame[at]] + b"\0"
        at += frame[at]
    body, crc = bytes(out[:-3]), bytes(out[-3:-1])
    return body if crc == struct.pack("<H", crc16(body)) else None


def test_example_of_page_is_what_is_sent() -> None:
    examples = [
        bytes.fromhex(found) for found in re.findall(r"`((?:[0-9A-F]{2} )+[0-9A-F]{2})`", PAGE.read_text())
    ]
    body, crc, line = examples
    assert order_frame(ChassisOrder(1, ChassisAction.ARM)) == line
    assert framed(body) == line
    assert uncobs(line[:-1]) == body + crc


@given(st.binary(max_size=FRAME_BYTES - 2))
def test_frames_round_trip_with_firmware(body: bytes) -> None:
    assert decoded(framed(body)[:-1]) == body
    assert list(frame_decoder().feed(framed(body))) == ([body] if body else [])
    assert encoded(body) == framed(body)


@given(st.binary(max_size=1000))
def test_the_encoding_has_no_zero_and_is_reversed(data: bytes) -> None:
    assert b"\0" not in cobs(data)
    assert len(cobs(data)) <= cobs_bytes(len(data))
    assert uncobs(cobs(data)) == data


@pytest.mark.parametrize("size", [253, 254, 255, 508, 509])
def test_long_block_costs_one_byte_per_254(size: int) -> None:
    assert len(cobs(b"x" * size)) == cobs_bytes(size) == size + -(-size // 254)
    assert uncobs(cobs(b"x" * size)) == b"x" * size
    assert uncobs(cobs(b"x" * size + b"\0")) == b"x" * size + b"\0"


@given(st.binary(min_size=1, max_size=1250))
def test_longer_frame_has_crc_of_32_bits(body: bytes) -> None:
    decoder = FrameDecoder(1254, crc32)
    line = serial_frame(body, crc32)
    assert list(decoder.feed(b"noise\0" + line[:3])) == []
    assert list(decoder.feed(line[3:])) == [body]
    assert sum(decoder.refused.values()) == 1


@given(st.lists(st.binary(max_size=400), max_size=8), st.binary(max_size=40))
def test_frame_is_found_after_noise_in_chassis(chunks: list[bytes], last: bytes) -> None:
    decoder = frame_decoder()
    for chunk in chunks:
        for body in decoder.feed(chunk):
            try:
                registry.encode(telemetry(body).report)
            except WireError:
                continue
    assert len(decoder._open) <= FRAME_BYTES + 1
    list(decoder.feed(b"\0"))
    assert list(decoder.feed(framed(b"\x81" + last))) == [b"\x81" + last]


@given(st.binary(max_size=FRAME_BYTES))
def test_report_of_any_bytes_is_report_or_refused(rest: bytes) -> None:
    try:
        found = telemetry(b"\x81" + rest)
    except WireError:
        return
    assert registry.decode(ChassisReport, registry.encode(found.report)) == found.report
    if found.battery is not None:
        assert math.isfinite(found.battery.voltage_v)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (encoded(b"\x81" + bytes(21))[:-3] + b"\x7f\x7f\0", "CRC wrong"),
        (b"\x09\x01\x02\0", "COBS: a block is cut short"),
        (b"\x01" * 300 + b"\0", "longer than a frame"),
    ],
)
def test_a_damaged_frame_is_refused_by_name(line: bytes, reason: str) -> None:
    decoder = frame_decoder()
    assert list(decoder.feed(line)) == []
    assert decoder.refused == {reason: 1}


def test_report_has_flags_and_measured_battery() -> None:
    body = struct.pack("<BQBfff", 0x81, 7, 0b1111, 24.5, 3.25, 1.5) + b"zu kalt"
    found = telemetry(body)
    assert found.report == ChassisReport(True, True, 7, "zu kalt", True)
    assert found.failsafe
    assert found.battery == BatteryState(24.5, 3.25, 1.0)
    assert telemetry(struct.pack("<BQBfff", 0x81, 7, 0, math.nan, 0.0, 0.0)).battery is None


def test_set_point_and_gains_arrive_unchanged() -> None:
    body = decoded(setpoint_frame(Setpoint(1.0, -0.5, 0.25, 2.0))[:-1])
    assert body is not None
    assert struct.unpack("<Bffff", body) == (1, 1.0, -0.5, 0.25, 2.0)
    body = decoded(order_frame(ChassisOrder(9, ChassisAction.GAINS, {"yaw_kp": 0.5}))[:-1])
    assert body == struct.pack("<BQB16sf", 2, 9, 4, b"yaw_kp", 0.5)


@pytest.mark.parametrize(
    ("order", "reason"),
    [
        (ChassisOrder(1, ChassisAction("wave")), "has no such order"),
        (ChassisOrder(1, ChassisAction.GAINS, {"x" * 17: 1.0}), "at most 16 characters"),
        (ChassisOrder(1, ChassisAction.GAINS, {f"g{n}": 1.0 for n in range(GAINS_LIMIT + 1)}), "at most 12"),
    ],
)
def test_order_that_does_not_fit_protocol_is_refused(order: ChassisOrder, reason: str) -> None:
    with pytest.raises(InvalidInput, match=reason):
        order_frame(order)


@given(st.booleans(), st.booleans(), st.booleans(), st.integers(0, (1 << 63) - 1), st.text(max_size=300))
def test_what_the_chassis_reports_arrives(
    armed: bool, landed: bool, failsafe: bool, answered: int, reason: str
) -> None:
    sent = Telemetry(ChassisReport(armed, landed, answered, reason, not armed), failsafe, None)
    body = decoded(report_frame(sent)[:-1])
    assert body is not None
    try:
        found = telemetry(body)
    except WireError:
        assert not reason.isprintable()
        return
    assert reason.startswith(found.report.refused)
    assert (found.report.armed, found.report.answered, found.failsafe) == (armed, answered, failsafe)


def test_chassis_reads_what_is_sent_to_it() -> None:
    for sent in (
        Setpoint(1.0, -0.5, 0.25, 2.0),
        ChassisOrder(9, ChassisAction.GAINS, {"yaw_kp": 0.5, "x": -1.0}),
        ChassisOrder(10, ChassisAction.KILL),
    ):
        line = setpoint_frame(sent) if isinstance(sent, Setpoint) else order_frame(sent)
        (body,) = frame_decoder().feed(line)
        assert command(body) == sent


@given(st.binary(max_size=60))
def test_any_bytes_are_a_command_or_refused(body: bytes) -> None:
    try:
        found = command(body)
    except WireError:
        return
    assert registry.decode(type(found), registry.encode(found)) == found


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (struct.pack("<Bffff", 1, math.nan, 0, 0, 0), "not finite"),
        (struct.pack("<BQB", 2, 1, 99), "invalid order"),
        (struct.pack("<BQB", 2, 1, 4) + b"x", "invalid order"),
        (struct.pack("<BQB16sf", 2, 1, 4, b"a", math.inf), "invalid gain"),
        (b"\x81", "neither"),
    ],
)
def test_command_without_valid_content_is_refused_by_name(body: bytes, reason: str) -> None:
    with pytest.raises(WireError, match=reason):
        command(body)
