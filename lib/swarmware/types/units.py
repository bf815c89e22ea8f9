"""Units by the end of a field's name."""

from typing import Final

UNITS: Final = (
    ("_rad_s2", "rad/s²"),
    ("_bytes_s", "B/s"),
    ("_bit_s", "bit/s"),
    ("_per_m3_s3_w", "W/(m/s)³"),
    ("_per_m_s_w", "W/(m/s)"),
    ("_1_s2", "1/s²"),
    ("_1_s", "1/s"),
    ("_m_s2", "m/s²"),
    ("_rad_s", "rad/s"),
    ("_deg_s", "°/s"),
    ("_m_s", "m/s"),
    ("_ns", "ns"),
    ("_us", "µs"),
    ("_ms", "ms"),
    ("_hz", "Hz"),
    ("_degc", "°C"),
    ("_deg", "°"),
    ("_rad", "rad"),
    ("_percent", "%"),
    ("_pct", "%"),
    ("_bytes", "B"),
    ("_mb", "MB"),
    ("_ratio", "1"),
    ("_ppm", "ppm"),
    ("_wh", "Wh"),
    ("_kg", "kg"),
    ("_pa", "Pa"),
    ("_m", "m"),
    ("_s", "s"),
    ("_v", "V"),
    ("_a", "A"),
    ("_w", "W"),
    ("_n", "N"),
    ("_k", "K"),
)
"""Ends of names and their units; the first that fits applies."""

_SHORT: Final = frozenset({"_m", "_s", "_v", "_a", "_w", "_n", "_k"})


def unit_of(name: str, *, whole: bool = False) -> str:
    """Unit of a field, or "" without one. A `whole` number with a short name is a count, not metres or
    seconds."""
    ending, unit = next(((e, u) for e, u in UNITS if name.endswith(e)), ("", ""))
    return "" if whole and ending in _SHORT else unit


def unit_suffix(unit: str) -> str:
    """The unit behind a value, after a blank; nothing for a ratio or a count."""
    return "" if unit in {"", "1"} else f" {unit}"
