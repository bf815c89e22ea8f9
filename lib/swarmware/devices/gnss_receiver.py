"""Bytes of satellite receivers: sentences of NMEA 0183 and frames of UBX, mixed, and noise between them."""

import re
from collections import Counter
from collections.abc import Iterator
from typing import Final

from swarmware.devices import ubx
from swarmware.devices.gnss_epochs import Epochs
from swarmware.devices.nmea import SentenceReader, fields_of
from swarmware.errors import WireError
from swarmware.types.vehicle import GnssFix

LINE_BYTES: Final = 128
"""Longest sentence that is taken; the standard has 82, receivers of several constellations send more."""
NO_SENTENCE: Final = "no sentence: expected $…*checksum"
_START: Final = re.compile(rb"[$\xb5]")
_BODY: Final = re.compile(rb"\$[ -#%-)+-~]*")
_WHOLE: Final = re.compile(rb"\$[ -#%-)+-~]+\*[0-9A-Fa-f]{2}")
_PART: Final = re.compile(rb"(\*[0-9A-Fa-f]?)?")
"""Partial checksum that may follow the body while the rest has not arrived."""
_CHECKSUM_BYTES: Final = 3
"""Length of a checksum: the star and two digits."""
_REASONS: Final = 50
"""Reasons that are counted apart; further ones are counted together."""
_OTHER: Final = "other reasons"
_NONE: Final = "none with a position: enable GGA (or GNS, RMC, UBX NAV-PVT) in the receiver"


class ReceiverDecoder:
    """Decodes the bytes of a receiver. `refused`: what was not understood, by the reason.

    It resynchronises at the newest start of a sentence or frame: a valid one after noise is taken.
    """

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self.valid = 0
        """Sentences and frames with a valid checksum, also of types that are not used."""
        self._open = bytearray()
        self._in_noise = False
        self._reader = SentenceReader()
        self._epochs = Epochs()
        self._reasons: Counter[str] = Counter()
        """Why messages since the last fix had none."""

    @property
    def reason(self) -> str:
        """Why the messages since the last fix had none: the most frequent reason."""
        return self._reasons.most_common(1)[0][0] if self._reasons else _NONE

    def feed(self, data: bytes) -> Iterator[GnssFix]:
        """The fixes in the next bytes of the line."""
        self._open += data
        while self._skip_noise():
            try:
                found = self._sentence() if self._open.startswith(b"$") else self._frame()
            except WireError as error:
                _add(self.refused, str(error))
                continue
            if found is None:
                return
            self._in_noise = False
            self.valid += 1
            fix = self._fix(found)
            if fix is not None:
                self._reasons.clear()
                yield fix

    def _skip_noise(self) -> bool:
        """Remove the bytes before the next start; returns False without a start."""
        start = _START.search(self._open)
        noise = bytes(self._open[: start.start() if start else len(self._open)])
        if noise.strip() and not self._in_noise:
            self.refused[NO_SENTENCE] += 1
        if noise:
            # noise that ends with a line counts once; the next noise is another one
            self._in_noise = noise[-1:] not in {b"\r", b"\n"}
            del self._open[: len(noise)]
        return start is not None

    def _sentence(self) -> list[str] | None:
        """Fields of the sentence at the start, or None if its end is missing.

        Raises: WireError when the start begins no sentence, after removing it.
        """
        body = _BODY.match(self._open)
        size = body.end() if body else 0
        whole = size + _CHECKSUM_BYTES
        if size > LINE_BYTES:
            self._drop(size)
            raise WireError(f"longer than {LINE_BYTES} bytes")
        if _PART.fullmatch(self._open, size):
            return None
        if self._open[size : size + 1] != b"*":
            self._drop(size)
            raise WireError(NO_SENTENCE)
        line = bytes(self._open[:whole])
        # bytes in the place of an invalid checksum may be the next start
        self._drop(whole if _WHOLE.fullmatch(line) else size + 1)
        return fields_of(line)

    def _frame(self) -> ubx.UbxFrame | None:
        """The frame at the start, or None if its end is missing.

        Raises: WireError when the start begins no frame, after removing its first byte: valid messages may
        follow.
        """
        opened = bytes(self._open)
        try:
            size = ubx.frame_bytes(opened)
            if size is not None and len(opened) >= size:
                found = ubx.frame_of(opened[:size])
                self._drop(size)
                return found
        except WireError:
            self._drop(1)
            raise
        within = _WHOLE.search(opened)
        if within is not None and _is_valid(within[0]):  # so the start was noise: its end may never come
            self._drop(within.start())
            raise WireError(NO_SENTENCE)
        return None

    def _drop(self, size: int) -> None:
        del self._open[:size]
        self._in_noise = True

    def _fix(self, found: list[str] | ubx.UbxFrame) -> GnssFix | None:
        """The fix of an epoch, if this message gives it."""
        try:
            position = ubx.position(found) if isinstance(found, ubx.UbxFrame) else self._reader.read(found)
            if position is None:
                return None
            if position.fix is not None and position.fix.lat_deg == position.fix.lon_deg == 0.0:
                raise WireError(f"{position.kind}: a fix at 0° 0°, as receivers send before their first fix")
        except WireError as error:
            _add(self.refused, str(error))
            _add(self._reasons, str(error))
            return None
        if position.reason:
            _add(self._reasons, position.reason)
        return self._epochs.take(position)


def _add(counts: Counter[str], reason: str) -> None:
    """Count a reason; bytes of the receiver are part of some, so that their number is limited."""
    counts[reason if reason in counts or len(counts) < _REASONS else _OTHER] += 1


def _is_valid(line: bytes) -> bool:
    try:
        fields_of(line)
    except WireError:
        return False
    return True
