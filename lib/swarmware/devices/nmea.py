"""Sentences of satellite receivers, NMEA 0183: fixes of bytes, and bytes of fixes; all else is refused."""

import math
import re
from collections import Counter
from collections.abc import Iterator
from functools import reduce
from operator import xor
from typing import Final

from swarmware.errors import WireError
from swarmware.types.vehicle import GnssFix

LINE_BYTES: Final = 128
"""Longest sentence that is taken; the standard has 82, receivers of several constellations send more."""
_ERROR_M: Final = {1: 5.0, 2: 1.0, 3: 5.0, 4: 0.02, 5: 0.5}
"""Horizontal error by the quality of GGA, at a dilution of 1: autonomous, differential, PPS, RTK fixed, RTK
float. Source: typical user range errors of such receivers."""
_NO_FIX: Final = frozenset({"0", "6", "7", "8", ""})
"""Qualities without a position that was measured: none, dead reckoning, manual, simulated."""
_NUMBER: Final = re.compile(r"-?([0-9]+(\.[0-9]*)?|\.[0-9]+)")
_GGA_FIELDS: Final = 15
_GST_FIELDS: Final = 9
_ACCURACY_S: Final = 5.0


class NmeaDecoder:
    """Decodes the bytes of a receiver. `refused`: what was not understood, by the reason."""

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self.valid = 0
        """Sentences with a valid checksum, also of types that are not used."""
        self._line = bytearray()
        self._overlong = False
        self._accuracy: tuple[float, float] | None = None
        """Horizontal standard deviation of the newest GST, and the time of day of its fix."""

    def feed(self, data: bytes) -> Iterator[GnssFix]:
        """The fixes in the next bytes of the line."""
        for part in data.splitlines(keepends=True):
            self._line += part
            complete = part[-1] in b"\r\n"
            if len(self._line) > LINE_BYTES:
                self._line.clear()
                self._overlong = True
            if not complete:
                continue
            line, overlong = bytes(self._line).strip(), self._overlong
            self._line.clear()
            self._overlong = False
            if overlong:
                self.refused[f"longer than {LINE_BYTES} bytes"] += 1
            elif line:
                fix = self._sentence(line)
                if fix is not None:
                    yield fix

    def _sentence(self, line: bytes) -> GnssFix | None:
        try:
            fields = fields_of(line)
            self.valid += 1
            match fields[0][-3:]:
                case "GGA":
                    return self._gga(fields)
                case "GST":
                    self._gst(fields)
        except WireError as error:
            self.refused[str(error)] += 1
        return None

    def _gga(self, fields: list[str]) -> GnssFix | None:
        if len(fields) != _GGA_FIELDS:
            raise WireError(f"GGA of {len(fields)} fields, expected {_GGA_FIELDS}")
        if fields[6] in _NO_FIX:
            return None
        error_m = _ERROR_M.get(int(number(fields[6], "quality")), 5.0)
        time_of_day = number(fields[1], "time")
        if self._accuracy is not None and abs(self._accuracy[1] - time_of_day) <= _ACCURACY_S:
            accuracy_m = self._accuracy[0]
        else:
            accuracy_m = error_m * number(fields[8], "dilution")
        return GnssFix(
            angle(fields[2], fields[3], "NS", 90.0),
            angle(fields[4], fields[5], "EW", 180.0),
            number(fields[9], "height", 1e5) + (number(fields[11], "geoid", 1e3) if fields[11] else 0.0),
            round(accuracy_m, 3),
            int(number(fields[7], "satellites", 999)),
        )

    def _gst(self, fields: list[str]) -> None:
        if len(fields) != _GST_FIELDS:
            raise WireError(f"GST of {len(fields)} fields, expected {_GST_FIELDS}")
        if fields[6] and fields[7]:
            sigma_m = math.hypot(number(fields[6], "latitude error"), number(fields[7], "longitude error"))
            self._accuracy = (sigma_m, number(fields[1], "time"))


def fields_of(line: bytes) -> list[str]:
    """The fields of a sentence with a valid checksum, the first without its `$`.

    Raises: WireError.
    """
    body, star, checksum = line.partition(b"*")
    if body[:1] != b"$" or not star:
        raise WireError("no sentence: expected $…*checksum")
    try:
        stated = int(checksum, 16) if len(checksum) == 2 else -1
        text = body[1:].decode("ascii")
    except ValueError:
        raise WireError("checksum or text invalid") from None
    if stated != reduce(xor, body[1:], 0):
        raise WireError("checksum wrong")
    return text.split(",")


def number(text: str, what: str, limit: float = 1e6) -> float:
    """A decimal number of at most this magnitude. Raises: WireError for anything else."""
    if not _NUMBER.fullmatch(text):
        raise WireError(f"{what}: no number")
    found = float(text)
    if abs(found) > limit:
        raise WireError(f"{what} out of range")
    return found


def angle(text: str, hemisphere: str, letters: str, limit_deg: float) -> float:
    """Degrees of `ddmm.mmmm` and a hemisphere. Raises: WireError."""
    value = number(text, "position")
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
