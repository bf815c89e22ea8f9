"""Notification rules: on change, with deadband and intervals (S0.62)."""

import math
from typing import Any, Final

import msgspec

from swarmd.tree.core.structure.index import pattern
from swarmware.errors import InvalidInput
from swarmware.types.tree import Rule

_decode = msgspec.msgpack.Decoder().decode
DEFAULT: Final = Rule(pattern="**")
_DEPTH: Final = 8
"""Deeper nesting counts as a change: payload types are flat."""


INTERVAL_MAX_S: Final = 86_400.0


def checked_s(name: str, seconds: float, greatest: float) -> float:
    """The duration, limited to the maximum.

    Raises: InvalidInput for a negative, infinite or NaN one.
    """
    if not 0 <= seconds < math.inf:
        raise InvalidInput(f"{name}: {seconds}; expected a duration of 0 s or more")
    return min(seconds, greatest)


def check_rule(rule: Rule) -> None:
    """Check a rule. Raises: InvalidInput for an invalid pattern, deadband or interval."""
    pattern(rule.pattern)
    where = f"rule {rule.pattern}"
    checked_s(f"{where}: min_interval_s", rule.min_interval_s, INTERVAL_MAX_S)
    checked_s(f"{where}: max_interval_s", rule.max_interval_s, INTERVAL_MAX_S)
    if not 0 <= rule.deadband < math.inf:
        raise InvalidInput(f"{where}: deadband {rule.deadband}; expected 0 or more")


def first_rule(path: str, rules: tuple[Rule, ...]) -> Rule | None:
    """The first rule whose pattern matches a path, or None if no pattern matches."""
    return next((rule for rule in rules if pattern(rule.pattern).matches(path)), None)


def rule_for(path: str, rules: tuple[Rule, ...]) -> Rule:
    """The first rule whose pattern matches a path, else any change."""
    return first_rule(path, rules) or DEFAULT


def differs(before: bytes, after: bytes, deadband: float) -> bool:
    """Whether two payloads differ by more than the deadband in some number, or at all in anything else."""
    if before == after:
        return False
    if deadband <= 0:
        return True
    try:
        return _differs(_decode(before), _decode(after), deadband, _DEPTH)
    except (msgspec.DecodeError, ValueError, RecursionError):
        return True  # packed or foreign: only equality means anything


def _differs(before: Any, after: Any, deadband: float, depth: int) -> bool:
    if depth == 0:
        return bool(before != after)
    if _number(before) and _number(after):
        # written so that NaN counts as a change
        return not abs(before - after) <= deadband
    if isinstance(before, list) and isinstance(after, list):
        return len(before) != len(after) or any(
            _differs(one, other, deadband, depth - 1) for one, other in zip(before, after, strict=True)
        )
    if isinstance(before, dict) and isinstance(after, dict):
        return before.keys() != after.keys() or any(
            _differs(before[key], after[key], deadband, depth - 1) for key in before
        )
    return bool(before != after)


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
