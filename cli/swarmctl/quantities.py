"""Rates and spans of time as people type them."""

import re
from typing import Final

from swarmware.errors import InvalidInput

_SPAN: Final = re.compile(r"(\d+(?:\.\d+)?)(ms|s|m|h|d)\Z")
_SECONDS: Final = {"ms": 0.001, "s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}
_RATE: Final = re.compile(r"(\d+(?:\.\d+)?)hz\Z")


def span_s(text: str) -> float:
    """A span of time: 30s, 5m, 2h, 1d, 200ms.

    Raises: InvalidInput when it is none.
    """
    found = _SPAN.match(text)
    if not found:
        raise InvalidInput(f"time {text!r}: expected 200ms, 30s, 5m, 2h or 1d")
    return float(found[1]) * _SECONDS[found[2]]


def rate_hz(text: str) -> float | None:
    """A rate: 5hz; None for `auto`, no limit.

    Raises: InvalidInput when it is none.
    """
    if text.lower() == "auto":
        return None
    found = _RATE.match(text.lower())
    if not found:
        raise InvalidInput(f"rate {text!r}: expected 5hz, 0.5hz, or auto")
    return float(found[1])
