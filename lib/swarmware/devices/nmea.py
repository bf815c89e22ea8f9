"""Sentences of satellite receivers, NMEA 0183: positions of sentences, and sentences of fixes."""

import math
import re
from enum import StrEnum
from functools import reduce
from operator import xor
from typing import Final

from swarmware.devices.gnss_epochs import Position, between_s
from swarmware.errors import WireError
from swarmware.types.vehicle import ACCURACY_MIN_M, GnssFix

_ERROR_M: Final = {1: 5.0, 2: 1.0, 3: 5.0, 4: 0.02, 5: 0.5}
"""Horizontal error by the quality of GGA, at a dilution of 1: autonomous, differential, PPS, RTK fixed, RTK
float. Source: typical user range errors of such receivers."""
_NO_FIX: Final = frozenset({"0", "6", "7", "8", ""})
"""Qualities without a position that was measured: none, dead reckoning, manual, simulated."""
_MODES: Final = {"R": 4, "F": 5, "D": 2, "P": 3, "A": 1}
"""Quality by the mode of GNS, RMC and GLL, the best one first: other modes have no measured position."""
_DILUTION: Final = 2.0
"""Dilution of a fix whose sentence states none, or zero; typical of a few satellites in a clear sky."""
_NUMBER: Final = re.compile(r"-?([0-9]+(\.[0-9]*)?|\.[0-9]+)")
_TIME: Final = re.compile(r"([01][0-9]|2[0-3])([0-5][0-9])([0-5][0-9]|60)(\.[0-9]*)?")
_CHECKSUM: Final = re.compile(rb"[0-9A-Fa-f]{2}")
_ACTIVE: Final = "A"
"""Status of RMC and GLL with a position; V is a warning."""


class SentenceType(StrEnum):
    """Sentences that are read, by the letters behind the talker."""

    GGA = "GGA"
    GNS = "GNS"
    RMC = "RMC"
    GLL = "GLL"
    GST = "GST"
    GSA = "GSA"


_FIELDS: Final = {
    SentenceType.GGA: range(15, 16),
    SentenceType.GNS: range(13, 15),
    SentenceType.RMC: range(12, 15),
    SentenceType.GLL: range(7, 9),
    SentenceType.GST: range(9, 10),
    SentenceType.GSA: range(18, 20),
}
"""Fields of the sentences that are read, with their name; later versions of the standard append some."""
_ACCURACY_S: Final = 5.0
"""Time for which the errors of a GST hold."""


class SentenceReader:
    """Reads positions from sentences; errors of GST and dimensions of GSA apply to those that follow."""

    def __init__(self) -> None:
        self._accuracy: tuple[float, float] | None = None
        """Horizontal standard deviation of the newest GST, and the time of day of its fix."""
        self._is_flat = False
        """The newest GSA says that the fix has two dimensions: a height beside it is not measured."""

    def read(self, fields: list[str]) -> Position | None:
        """The position in a sentence, or None if its type has none. Raises: WireError."""
        # sentences of manufacturers begin with P and have other fields
        if fields[0].startswith("P") or fields[0][2:] not in _FIELDS:
            return None
        kind = SentenceType(fields[0][2:])
        expected = _FIELDS[kind]
        # a valid checksum does not prove that the sentence is of this standard
        if len(fields) not in expected:
            wanted = " to ".join(dict.fromkeys((str(expected[0]), str(expected[-1]))))
            raise WireError(f"{kind} of {len(fields)} fields, expected {wanted}")
        match kind:
            case SentenceType.GGA:
                return self._gga(fields)
            case SentenceType.GNS:
                return self._gns(fields)
            case SentenceType.RMC:
                return self._without_height(kind, fields[1], fields[3:7], fields[2], fields[12:13])
            case SentenceType.GLL:
                return self._without_height(kind, fields[5], fields[1:5], fields[6], fields[7:8])
            case SentenceType.GST:
                self._gst(fields)
            case SentenceType.GSA:
                self._is_flat = fields[2] == "2"
        return None

    def _gga(self, fields: list[str]) -> Position:
        # returned without a fix: the receiver works, and says why it has none
        if fields[6] in _NO_FIX:
            return Position(SentenceType.GGA, 0.0, None, f"GGA: no fix (quality {fields[6] or 'empty'})")
        quality = int(number(fields[6], "quality"))
        height_m = self._height_m(fields[9], fields[11])
        # units are checked only where the number is used
        if math.isfinite(height_m):
            _expect_metres(fields[10], "height")
            if fields[11]:
                _expect_metres(fields[12], "geoid")
        time_s = time_of_day_s(fields[1])
        accuracy_m = self._accuracy_m(time_s, quality, fields[8])
        return Position(
            SentenceType.GGA,
            time_s,
            _fix(fields[2:6], height_m, accuracy_m, _satellites(SentenceType.GGA, fields[7])),
        )

    def _gns(self, fields: list[str]) -> Position:
        quality = _quality(fields[6])
        if quality == 0 or not fields[2]:
            return Position(SentenceType.GNS, 0.0, None, f"GNS: no fix (mode {fields[6] or 'empty'})")
        time_s = time_of_day_s(fields[1])
        height_m = self._height_m(fields[9], fields[10])
        accuracy_m = self._accuracy_m(time_s, quality, fields[8])
        return Position(
            SentenceType.GNS,
            time_s,
            _fix(fields[2:6], height_m, accuracy_m, _satellites(SentenceType.GNS, fields[7])),
        )

    def _without_height(
        self, kind: str, time: str, place: list[str], status: str, modes: list[str]
    ) -> Position:
        """A position of RMC or GLL; the mode is missing before version 2.3 of the standard."""
        # sentences of older receivers have no mode; their status alone decides
        mode = "".join(modes) or "A"
        quality = _quality(mode)
        if status != _ACTIVE or quality == 0:
            return Position(kind, 0.0, None, f"{kind}: no fix (status {status or 'empty'}, mode {mode})")
        time_s = time_of_day_s(time)
        return Position(kind, time_s, _fix(place, math.nan, self._accuracy_m(time_s, quality, ""), 0))

    def _height_m(self, height: str, geoid: str) -> float:
        """Height above the ellipsoid, or NaN in a fix of two dimensions."""
        if not height or self._is_flat:
            return math.nan
        return number(height, "height", 1e5) + (number(geoid, "geoid", 1e3) if geoid else 0.0)

    def _accuracy_m(self, time_s: float, quality: int, dilution: str) -> float:
        # a measured error is better than an estimate from the dilution
        if self._accuracy is not None and between_s(self._accuracy[1], time_s) <= _ACCURACY_S:
            return self._accuracy[0]
        stated = number(dilution, "dilution") if dilution else 0.0
        if stated < 0:
            raise WireError("dilution out of range")
        return max(ACCURACY_MIN_M, _ERROR_M.get(quality, 5.0) * (stated or _DILUTION))

    def _gst(self, fields: list[str]) -> None:
        if not (fields[6] and fields[7]):
            return
        sigma_m = math.hypot(number(fields[6], "latitude error"), number(fields[7], "longitude error"))
        # some receivers fill the fields with zeros before they have errors
        if sigma_m == 0.0:
            self._accuracy = None
            raise WireError("GST: errors of zero; the dilution is used instead")
        self._accuracy = (max(ACCURACY_MIN_M, sigma_m), time_of_day_s(fields[1]))


def _quality(modes: str) -> int:
    """Quality of the best mode, of one letter for each constellation, or 0 if none measures a position."""
    return next((quality for mode, quality in _MODES.items() if mode in modes), 0)


def _satellites(kind: str, text: str) -> int:
    found = int(number(text, "satellites", 999))
    # a fix without satellites is a simulation or a fault
    if found <= 0:
        raise WireError(f"{kind}: a fix without satellites")
    return found


def _expect_metres(unit: str, what: str) -> None:
    if unit != "M":
        raise WireError(f"GGA: unit of the {what} is {unit or 'empty'}; expected M")


def _fix(place: list[str], height_m: float, accuracy_m: float, satellites: int) -> GnssFix:
    lat_deg, lon_deg = angle(place[0], place[1], "NS", 90.0), angle(place[2], place[3], "EW", 180.0)
    return GnssFix(lat_deg, lon_deg, height_m, round(accuracy_m, 3), satellites)


def fields_of(line: bytes) -> list[str]:
    """The fields of a sentence with a valid checksum, the first without its `$`.

    Raises: WireError.
    """
    body, star, stated = line.partition(b"*")
    if body[:1] != b"$" or not star:
        raise WireError("no sentence: expected $…*checksum")
    # `int` would also accept signs, spaces and underscores
    if not (_CHECKSUM.fullmatch(stated) and body.isascii()):
        raise WireError("checksum or text invalid")
    if int(stated, 16) != reduce(xor, body[1:], 0):
        raise WireError("checksum wrong")
    return body[1:].decode("ascii").split(",")


def number(text: str, what: str, limit: float = 1e6) -> float:
    """A decimal number of at most this magnitude. Raises: WireError for anything else."""
    if not _NUMBER.fullmatch(text):
        raise WireError(f"{what}: no number")
    found = float(text)
    if abs(found) > limit:
        raise WireError(f"{what} out of range")
    return found


def time_of_day_s(text: str) -> float:
    """Seconds since midnight of `hhmmss.ss`. Raises: WireError."""
    found = _TIME.fullmatch(text)
    if found is None:
        raise WireError("time: expected hhmmss.ss")
    hours, minutes, seconds, fraction = found.groups()
    return (int(hours) * 60 + int(minutes)) * 60 + int(seconds) + float(f"0{fraction or ''}")


def angle(text: str, hemisphere: str, letters: str, limit_deg: float) -> float:
    """Degrees of `ddmm.mmmm` and a hemisphere. Raises: WireError."""
    value = number(text, "position")
    # `ddmm.mmmm`: hundreds are degrees, the rest are minutes
    degrees, minutes = divmod(value, 100)
    found = degrees + minutes / 60
    if len(hemisphere) != 1 or hemisphere not in letters or minutes >= 60 or not 0 <= found <= limit_deg:
        raise WireError("position out of range")
    return found if hemisphere == letters[0] else -found


def sentence(body: str) -> bytes:
    """A sentence with `$`, checksum and line end."""
    checked = body.encode("ascii")
    return b"$%b*%02X\r\n" % (checked, reduce(xor, checked, 0))


def fix_sentences(fix: GnssFix, time_of_day_s: float) -> bytes:
    """The sentences GST (accuracy) and GGA (position) of a fix.

    The geoid is the ellipsoid, so that both heights are equal. Quality: RTK fixed below 0.1 m, else
    autonomous.
    """
    hours, rest_s = divmod(time_of_day_s % 86_400.0, 3600.0)
    minutes, seconds = divmod(rest_s, 60.0)
    clock = f"{int(hours):02d}{int(minutes):02d}{min(int(seconds * 100), 5999) / 100:05.2f}"
    # equal errors of both axes, whose root sum is the horizontal error
    axis_m = fix.h_acc_m / math.sqrt(2)
    gst = f"GPGST,{clock},,,,,{axis_m:.4f},{axis_m:.4f},{fix.h_acc_m:.4f}"
    gga = ",".join(
        [
            f"GPGGA,{clock}",
            _spelled(fix.lat_deg, 2, "NS"),
            _spelled(fix.lon_deg, 3, "EW"),
            "4" if fix.h_acc_m < 0.1 else "1",
            f"{fix.satellites:02d},0.8,{fix.alt_ellipsoid_m:.3f},M,0.0,M,,",
        ]
    )
    return sentence(gst) + sentence(gga)


def _spelled(angle_deg: float, digits: int, letters: str) -> str:
    """`ddmm.mmmmmmm` and the hemisphere: seven decimals are 0.2 mm."""
    degrees, minutes_e7 = divmod(round(abs(angle_deg) * 60e7), 600_000_000)
    minutes = f"{minutes_e7 // 10**7:02d}.{minutes_e7 % 10**7:07d}"
    return f"{degrees:0{digits}d}{minutes},{letters[angle_deg < 0]}"
