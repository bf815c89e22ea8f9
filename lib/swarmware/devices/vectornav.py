"""Binary frames of inertial units of VectorNav: attitude, rates and specific force."""

import binascii
import math
import struct
from collections import Counter
from collections.abc import Iterator
from typing import Final

from swarmware.errors import WireError
from swarmware.types.vehicle import Imu

_HEADER: Final = b"\xfa\x01\x28\x01"
"""Sync, group 1, fields yaw-pitch-roll (bit 3), angular rate (bit 5), acceleration (bit 8)."""
_BODY: Final = struct.Struct("<9f")
_CRC: Final = struct.Struct(">H")
FRAME_BYTES: Final = len(_HEADER) + _BODY.size + _CRC.size
_RATE_MAX_RAD_S: Final = 100.0
_FORCE_MAX_M_S2: Final = 1000.0
"""Far beyond every unit: such values are damage that the CRC did not find."""


def frame(imu: Imu) -> bytes:
    """The frame of a measurement; angles that it does not have are zero.

    Source: VectorNav VN-100 user manual, binary output messages: angles in degrees of the body frame
    forward, right, down in north, east, down.
    """
    yaw_rad = imu.yaw_rad or 0.0
    body = _BODY.pack(
        math.degrees(math.remainder(math.pi / 2 - yaw_rad, math.tau)),
        0.0 - math.degrees(imu.pitch_rad or 0.0),
        math.degrees(imu.roll_rad or 0.0),
        imu.wx_rad_s,
        -imu.wy_rad_s,
        -imu.wz_rad_s,
        imu.ax_m_s2,
        -imu.ay_m_s2,
        -imu.az_m_s2,
    )
    checked = _HEADER[1:] + body
    return _HEADER[:1] + checked + _CRC.pack(binascii.crc_hqx(checked, 0))


def measurement(body: bytes) -> Imu:
    """The values of a frame without header and CRC. Raises: WireError."""
    yaw_deg, pitch_deg, roll_deg, wx, wy, wz, ax, ay, az = _BODY.unpack(body)
    # forward, right, down to forward, left, up
    rates, forces = (wx, -wy, -wz), (ax, -ay, -az)
    valid = all(abs(angle) <= 360 for angle in (yaw_deg, pitch_deg, roll_deg))
    valid = valid and all(abs(rate) <= _RATE_MAX_RAD_S for rate in rates)
    if not valid or not all(abs(force) <= _FORCE_MAX_M_S2 for force in forces):
        raise WireError("value out of range")
    return Imu(
        *rates,
        *forces,
        math.remainder(math.pi / 2 - math.radians(yaw_deg), math.tau),
        math.radians(roll_deg),
        -math.radians(pitch_deg),
    )


class VectorNavDecoder:
    """Decodes the bytes of a unit. `refused`: what was not understood, by the reason."""

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self.valid = 0
        """Valid frames so far."""
        self._open = bytearray()

    def feed(self, data: bytes) -> Iterator[Imu]:
        """The measurements in the next bytes of the line."""
        self._open += data
        while True:
            start = self._open.find(_HEADER[:1])
            if start != 0:
                skipped = len(self._open) if start < 0 else start
                if skipped:
                    self.refused["no frame"] += 1
                del self._open[:skipped]
            if len(self._open) < FRAME_BYTES:
                return
            found = bytes(self._open[:FRAME_BYTES])
            try:
                imu = self._measurement(found)
            except WireError as error:
                self.refused[str(error)] += 1
                # only the first byte: a valid frame may begin inside of the refused one
                del self._open[0]
                continue
            del self._open[:FRAME_BYTES]
            self.valid += 1
            yield imu

    def _measurement(self, found: bytes) -> Imu:
        if not found.startswith(_HEADER):
            raise WireError("another output: expected group 1 with the fields 0x0128")
        # with its own CRC at the end a body has the remainder 0
        if binascii.crc_hqx(found[1:], 0) != 0:
            raise WireError("CRC wrong")
        return measurement(found[len(_HEADER) : -_CRC.size])
