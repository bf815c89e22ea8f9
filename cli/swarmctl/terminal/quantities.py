"""Rates, sizes and durations in arguments."""

import re
from datetime import UTC, datetime
from typing import Final

from swarmware.errors import InvalidInput

_SPAN: Final = re.compile(r"(\d+(?:\.\d+)?)(ms|s|m|h|d)\Z")
_SECONDS: Final = {"ms": 0.001, "s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}
_SIZE: Final = re.compile(r"(\d+(?:\.\d+)?)(B|[kKM]B|[KM]iB)\Z")
_BYTES: Final = {"b": 1, "kb": 1000, "mb": 1_000_000, "kib": 1024, "mib": 1024 * 1024}
_BIT_RATE: Final = re.compile(r"(\d+(?:\.\d+)?)(kbit|mbit|gbit|bit)\Z")
_BITS: Final = {"bit": 1.0, "kbit": 1e3, "mbit": 1e6, "gbit": 1e9}
_RATE: Final = re.compile(r"(\d+(?:\.\d+)?)hz\Z")


def span_s(text: str) -> float:
    """Parse a duration: 30s, 5m, 2h, 1d, 200ms.

    Raises: InvalidInput for any other text.
    """
    found = _SPAN.match(text)
    if not found:
        raise InvalidInput(f"time {text!r}: expected 200ms, 30s, 5m, 2h or 1d")
    return float(found[1]) * _SECONDS[found[2]]


def spoken(span: float) -> str:
    """Text of a duration: 0.4s, 42s, 3m49s, 2h05m, 3d04h."""
    if span < 10:
        return f"{span:.1f}s"
    seconds = round(span)
    if seconds < 60:
        return f"{seconds}s"
    if seconds < 3600:
        return f"{seconds // 60}m{seconds % 60:02}s"
    if seconds < 86400:
        return f"{seconds // 3600}h{seconds % 3600 // 60:02}m"
    return f"{seconds // 86400}d{seconds % 86400 // 3600:02}h"


def utc_text(instant_utc_ns: int) -> str:
    """An instant in UTC to the millisecond: 2026-11-22T16:05:37.123Z."""
    # cut to milliseconds in integers: a float of nanoseconds since 1970 is exact to 256 ns only, and rounds
    # up
    moment = datetime.fromtimestamp(instant_utc_ns // 1_000_000 / 1000, UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def bit_s(text: str) -> int:
    """Parse a bit rate: 1mbit, 250kbit.

    Raises: InvalidInput for any other text.
    """
    found = _BIT_RATE.match(text.lower())
    if not found or not float(found[1]):
        raise InvalidInput(f"rate {text!r}: expected 1mbit or 250kbit")
    return round(float(found[1]) * _BITS[found[2]])


def rate_hz(text: str) -> float:
    """Parse a rate: 5hz, 0.5hz.

    Raises: InvalidInput for any other text.
    """
    found = _RATE.match(text.lower())
    if not found:
        raise InvalidInput(f"rate {text!r}: expected 5hz, 0.5hz, max, auto or default")
    return float(found[1])


def size_bytes(text: str) -> int:
    """Parse a size: 500B, 64kB, 2MB, 1MiB.

    Raises: InvalidInput for any other text.
    """
    found = _SIZE.match(text)
    if not found:
        raise InvalidInput(f"size {text!r}: expected 500B, 64kB, 2MB or 1MiB")
    return round(float(found[1]) * _BYTES[found[2].lower()])


def bit_rate_bytes_s(text: str) -> float:
    """Parse the rate of a link: 250kbit, 5mbit, 1gbit; in bytes per second.

    Raises: InvalidInput for any other text.
    """
    found = _BIT_RATE.match(text.lower())
    if not found or not float(found[1]):
        raise InvalidInput(f"rate of a link {text!r}: expected 250kbit, 5mbit or 1gbit")
    return float(found[1]) * _BITS[found[2]] / 8
