"""Frames on the serial line of a chassis, both directions: COBS, CRC-16, contents (`chassis-protocol.md`)."""

import math
import struct
from typing import Final

import msgspec

from swarmware.devices.serial_frames import CRC16_BYTES, FrameDecoder, crc16, serial_frame
from swarmware.errors import InvalidInput, WireError
from swarmware.types.chassis import ChassisAction, ChassisOrder, ChassisReport
from swarmware.types.vehicle import BatteryState, Setpoint

FRAME_BYTES: Final = 254
"""Longest frame before its encoding: with this limit COBS adds exactly one byte."""
_SETPOINT, _ORDER, _REPORT = 0x01, 0x02, 0x81
_ACTIONS: Final = {
    ChassisAction.ARM: 1,
    ChassisAction.DISARM: 2,
    ChassisAction.KILL: 3,
    ChassisAction.GAINS: 4,
    ChassisAction.CALIBRATE: 5,
}
_BY_NUMBER: Final = {number: action for action, number in _ACTIONS.items()}
_SETPOINT_BODY: Final = struct.Struct("<Bffff")
_ORDER_BODY: Final = struct.Struct("<BQB")
_GAIN: Final = struct.Struct("<16sf")
_REPORT_BODY: Final = struct.Struct("<BQBfff")
_ARMED, _LANDED, _CALIBRATING, _FAILSAFE = 1, 2, 4, 8
"""Flags of a report."""
GAINS_LIMIT: Final = (FRAME_BYTES - _ORDER_BODY.size - CRC16_BYTES) // _GAIN.size
REASON_BYTES: Final = FRAME_BYTES - _REPORT_BODY.size - CRC16_BYTES


class Telemetry(msgspec.Struct, frozen=True):
    """Content of a report on the line."""

    report: ChassisReport
    failsafe: bool
    """Whether the chassis stopped by its own watchdog."""
    battery: BatteryState | None
    """State of the battery, or None if the chassis does not measure it."""


def setpoint_frame(setpoint: Setpoint) -> bytes:
    """The frame of a set-point, with its delimiter."""
    return framed(
        _SETPOINT_BODY.pack(_SETPOINT, setpoint.vx_m_s, setpoint.vy_m_s, setpoint.vz_m_s, setpoint.wz_rad_s)
    )


def order_frame(order: ChassisOrder) -> bytes:
    """The frame of an order, with its delimiter. Raises: InvalidInput when it has no form on the line."""
    if order.action not in _ACTIONS:
        raise InvalidInput(f"{order.action}: the protocol of the chassis has no such order")
    body = _ORDER_BODY.pack(_ORDER, order.number, _ACTIONS[order.action])
    if len(order.gains) > GAINS_LIMIT:
        raise InvalidInput(f"{len(order.gains)} gains, expected at most {GAINS_LIMIT} in one order")
    for name, value in order.gains.items():
        spelled = name.encode("ascii", "replace")
        if len(spelled) > 16:
            raise InvalidInput(f"gain {name!r}: expected a name of at most 16 characters")
        body += _GAIN.pack(spelled, value)
    return framed(body)


def telemetry(frame: bytes) -> Telemetry:
    """The report in a frame without its framing. Raises: WireError."""
    if frame[:1] != bytes([_REPORT]):
        raise WireError(f"frame of kind {frame[0]}" if frame else "empty frame")
    if not _REPORT_BODY.size <= len(frame) <= _REPORT_BODY.size + REASON_BYTES:
        raise WireError("report of a wrong length")
    _, answered, flags, voltage_v, current_a, remaining = _REPORT_BODY.unpack_from(frame)
    if answered >= 1 << 63:
        raise WireError("report with a number of more than 63 bits")
    reason = frame[_REPORT_BODY.size :].decode("utf-8", "replace")
    if not reason.isprintable():
        raise WireError("report with an unprintable reason")
    battery: BatteryState | None = None
    if math.isfinite(voltage_v) and math.isfinite(current_a) and math.isfinite(remaining):
        charge = min(max(remaining, 0.0), 1.0)
        battery = BatteryState(round(voltage_v, 3), round(current_a, 3), charge)
    return Telemetry(
        ChassisReport(
            bool(flags & _ARMED), bool(flags & _LANDED), answered, reason, bool(flags & _CALIBRATING)
        ),
        bool(flags & _FAILSAFE),
        battery,
    )


def command(frame: bytes) -> Setpoint | ChassisOrder:
    """The set-point or order in a frame without its framing: what the chassis receives. Raises: WireError."""
    if frame[:1] == bytes([_SETPOINT]) and len(frame) == _SETPOINT_BODY.size:
        values = _SETPOINT_BODY.unpack(frame)[1:]
        if not all(math.isfinite(value) for value in values):
            raise WireError("set-point that is not finite")
        return Setpoint(*values)
    if frame[:1] != bytes([_ORDER]) or len(frame) < _ORDER_BODY.size:
        raise WireError("neither a set-point nor an order")
    _, order, action = _ORDER_BODY.unpack_from(frame)
    gains = frame[_ORDER_BODY.size :]
    if order >= 1 << 63 or action not in _BY_NUMBER or len(gains) % _GAIN.size:
        raise WireError("invalid order")
    found: dict[str, float] = {}
    for name, value in _GAIN.iter_unpack(gains):
        spelled = name.rstrip(b"\0").decode("ascii", "replace")
        if not spelled.isprintable() or not math.isfinite(value):
            raise WireError("invalid gain")
        found[spelled] = value
    return ChassisOrder(order, _BY_NUMBER[action], found)


def report_frame(content: Telemetry) -> bytes:
    """The frame of a report, with its delimiter: what the chassis sends."""
    report, battery = content.report, content.battery
    flags = (
        _ARMED * report.armed
        | _LANDED * report.landed
        | _CALIBRATING * report.calibrating
        | _FAILSAFE * content.failsafe
    )
    measured = (math.nan,) * 3
    if battery is not None:
        measured = (battery.voltage_v, battery.current_a, battery.remaining_ratio)
    reason = report.refused.encode("utf-8")[:REASON_BYTES].decode("utf-8", "ignore").encode("utf-8")
    return framed(_REPORT_BODY.pack(_REPORT, report.answered, flags, *measured) + reason)


def framed(body: bytes) -> bytes:
    """A body with its CRC, encoded by COBS, and the delimiter."""
    return serial_frame(body, crc16)


def frame_decoder() -> FrameDecoder:
    """A decoder for the bytes of a chassis's serial line."""
    return FrameDecoder(FRAME_BYTES, crc16)
