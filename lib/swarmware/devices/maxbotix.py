"""Readings of MaxBotix sonars on a serial line: `R`, a number, a carriage return."""

from collections import Counter
from collections.abc import Iterator
from enum import StrEnum
from typing import Final

from swarmware.errors import WireError

_LINE_BYTES: Final = 6


class SonarUnit(StrEnum):
    """Unit of the numbers of a model, whose readings have three or four digits."""

    INCH = "inch"
    CM = "cm"
    MM = "mm"


_METRES: Final = {SonarUnit.INCH: 0.0254, SonarUnit.CM: 0.01, SonarUnit.MM: 0.001}
_DIGITS: Final = {SonarUnit.INCH: 3, SonarUnit.CM: 3, SonarUnit.MM: 4}


def reading(range_m: float, unit: SonarUnit) -> bytes:
    """The reading of a range. Source: MaxBotix data sheets LV-, XL- and HRXL-MaxSonar, pin 5."""
    digits = _DIGITS[unit]
    number = min(max(round(range_m / _METRES[unit]), 0), 10**digits - 1)
    return f"R{number:0{digits}d}\r".encode("ascii")


class SonarDecoder:
    """Decodes the bytes of a sonar. `refused`: what was not understood, by the reason."""

    def __init__(self, unit: SonarUnit) -> None:
        self.refused: Counter[str] = Counter()
        self.valid = 0
        """Valid readings so far."""
        self._unit = unit
        self._line = bytearray()

    def feed(self, data: bytes) -> Iterator[float]:
        """The ranges in the next bytes of the line, in metres."""
        for part in data.splitlines(keepends=True):
            # one byte more than a reading shows that it is too long; the rest is not kept
            self._line += part[: _LINE_BYTES + 1 - len(self._line)]
            if part[-1:] not in {b"\r", b"\n"}:
                continue
            line = bytes(self._line).strip()
            self._line.clear()
            if not line:
                continue
            try:
                found = self._range_m(line)
            except WireError as error:
                self.refused[str(error)] += 1
                continue
            self.valid += 1
            yield found

    def _range_m(self, line: bytes) -> float:
        digits = _DIGITS[self._unit]
        if line[:1] != b"R" or len(line) != digits + 1 or not line[1:].isdigit():
            raise WireError(f"no reading: expected R and {digits} digits")
        return int(line[1:]) * _METRES[self._unit]
