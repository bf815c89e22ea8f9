"""Measured placement of a platform's applications on its computers (S1.14–17)."""

from typing import Annotated

import msgspec

from swarmware.types.registry import register


@register
class PlacementRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request of `sys/tree/placement`: measure the data that this computer receives from others."""

    window_s: Annotated[float, msgspec.Meta(gt=0, le=10)] = 2.0
    """Time over which values, delays and processor time are measured."""


@register
class PlacedApplication(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """An application of this computer."""

    name: str
    cpu_percent: float
    """Processor time of its process, as a share of one core."""
    in_process: int
    """Number of applications in that process."""
    loop_lag_ms: float
    """Lateness of its event loop in the last second."""
    interfaces: int
    """Resources that it provides, commands that it serves, and resources that it reads."""


@register
class RemoteInput(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A resource of another computer of the platform that an application of this one reads."""

    path: str
    unit: str
    """Computer that provides it."""
    applications: tuple[str, ...]
    """Applications that read it here."""
    within_s: float
    """Shortest delay that one of them states to need, or else age above which its owner declares a value
    stale, or 0 if neither is stated."""
    values: int = 0
    """Values that arrived while it was measured."""
    payload_bytes: int = 0
    """Total payload of these values."""
    delay_mean_ms: float | None = None
    """Time from the stamp of a value to its arrival, or None without a value or a known clock."""
    delay_p95_ms: float | None = None
    delay_worst_ms: float | None = None


@register
class UnitPlacement(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Services of one computer, its inputs from the platform's other computers, and its load."""

    platform: str
    unit: str
    window_s: float
    cores: int
    busy_percent: float
    """Processor time of the whole computer in the window, as a share of one core."""
    applications: tuple[PlacedApplication, ...] = ()
    inputs: tuple[RemoteInput, ...] = ()
    rates_bit_s: dict[str, float] = {}
    """Rates of its links to the platform's other computers, as configured or measured; others are unknown."""


@register
class InputDelays(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Delays of an input from another computer in the last second (boards `nav/imu_delay`, `nav/pose_delay`).

    Each is the time from the stamp of a value to its use.
    """

    mean_ms: float
    worst_ms: float
    delays_ms: tuple[float, ...] = ()
    """Delay of each value, in their order."""
