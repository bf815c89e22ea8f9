"""Values as text: one name per field, with units, and angles in degrees."""

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

from swarmctl.resources.values import brief
from swarmctl.terminal.wrapping import wrapped
from swarmware.types.json_form import json_form
from swarmware.types.units import unit_of, unit_suffix

QUATERNION: Final = ("x", "y", "z", "w")
VERTICAL: Final = 1 - 1e-9
"""Sine of the pitch at gimbal lock, where roll and yaw turn about the same axis and the roll counts as 0."""
INDENT: Final = "  "


class Angles(NamedTuple):
    """Attitude as angles, in the order yaw, pitch, roll about z, y, x (REP-103)."""

    roll_deg: float
    pitch_deg: float
    yaw_deg: float

    def __str__(self) -> str:
        return f"roll {self.roll_deg:.1f}°, pitch {self.pitch_deg:.1f}°, yaw {self.yaw_deg:.1f}°"


def angles_of(x: float, y: float, z: float, w: float) -> Angles | None:
    """Angles of a quaternion, or None if its length is zero or not finite.

    Source: Diebel, Representing Attitude (2006), section 8.
    """
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if not 0 < length < math.inf:
        return None
    x, y, z, w = x / length, y / length, z / length, w / length
    sine = 2 * (w * y - z * x)
    # rounding may exceed 1, for which asin raises
    rise = max(-1.0, min(1.0, sine))
    pitch = math.asin(rise)
    if abs(rise) > VERTICAL:
        # only the sum or difference of roll and yaw is determined here, and the yaw gets all of it
        return _rounded(0.0, pitch, -math.copysign(2 * math.atan2(x, w), rise))
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return _rounded(roll, pitch, yaw)


def _rounded(*angles: float) -> Angles:
    # adding 0.0 turns -0.0 into 0.0
    return Angles(*(round(math.degrees(angle), 3) + 0.0 for angle in angles))


def attitudes(value: Any) -> dict[str, Angles]:
    """Angles of each quaternion in a value, by the name before its components: `qx` … `qw`, or `x` … `w`."""
    found: dict[str, Angles] = {}
    flat = dict(_flat(value, ""))
    for name in flat:
        for end in ("qx", "x"):
            head = name.removesuffix(end)
            # a plain `x` counts only as the field of a nested value: `max` also ends in x
            if head == name or (end == "x" and not head.endswith(".")):
                continue
            parts = [flat.get(f"{head}{end[:-1]}{axis}") for axis in QUATERNION]
            numbers = [part for part in parts if isinstance(part, int | float)]
            if len(numbers) == len(QUATERNION) and (angles := angles_of(*numbers)):
                found[head.strip("._")] = angles
            break
    return found


def shown_fields(value: Any, unit: str = "") -> list[tuple[str, str]]:
    """Name and text of each field; a single value has an empty name and the unit of its resource."""
    if not isinstance(value, dict):
        return [("", with_unit(value, unit))]
    rows = [
        (name, with_unit(item, unit_of(name, whole=isinstance(item, int)))) for name, item in _flat(value, "")
    ]
    for name, angles in attitudes(value).items():
        rows.append((f"{name}.attitude" if name else "attitude", str(angles)))
    return rows


def with_unit(value: Any, unit: str) -> str:
    """A plain value as text, radians also in degrees."""
    text = ", ".join(map(brief, value)) if value and isinstance(value, list) else brief(json_form(value, ""))
    if not unit_suffix(unit) or value is None or value == []:
        return text or "''"
    degrees = ""
    if unit == "rad" and isinstance(value, float) and math.isfinite(value):
        degrees = f" ({math.degrees(value):.1f}°)"
    return f"{text} {unit}{degrees}"


def _flat(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Plain values inside a value, by dotted names; a list of plain values counts as one value."""
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from _flat(item, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        for place, item in enumerate(value):
            yield from _flat(item, f"{name}.{place}" if name else str(place))
    else:
        yield name, value


def block(rows: list[tuple[str, str]], width: int | None) -> list[str]:
    """A line per field, names and values aligned; long values continue below, never inside a word.

    A single value without a name is not indented.
    """
    longest = max((len(name) for name, _ in rows), default=0)
    lines: list[str] = []
    for name, text in rows:
        head = f"{INDENT}{name:<{longest}}  " if longest else ""
        lines += wrapped(text, width, head, " " * len(head))
    return lines


def flow(rows: list[tuple[str, str]], width: int | None, head: str) -> list[str]:
    """All fields in one line, or as many as the width needs; a field that fits in a line stays whole."""
    items = [f"{name} {text}".strip() for name, text in rows]
    if width is None:
        return [head + "  ".join(items)]
    lines = [head]
    for item in items:
        gap = "" if lines[-1] in {head, INDENT} else "  "
        if lines[-1].strip() and len(lines[-1]) + len(gap) + len(item) > width:
            lines.append(INDENT)
            gap = ""
        first, *rest = wrapped(item, width, lines[-1] + gap, INDENT * 2)
        lines[-1:] = [first, *rest]
    return lines
