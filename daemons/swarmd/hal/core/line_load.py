"""What drivers ask of the lines and buses to their devices, against what these carry (S1.17)."""

from collections.abc import Iterable, Mapping
from typing import Final

import msgspec

from swarmware.types.vehicle import LineLoad

CAPACITY_RATIO: Final = 0.8
"""Share of a line above which values wait for it: as that of the cores in `doctor placement`."""
I2C_BIT_S: Final = 100_000.0
"""Standard mode, where no other rate is configured. Source: NXP UM10204."""
CAN_BIT_S: Final = 500_000.0
"""The rate that the manual of the drivers sets, where no other one is configured."""
SERIAL_BITS: Final = 10
"""Start bit, eight bits, stop bit."""
I2C_BITS: Final = 9
"""Eight bits and the acknowledgement."""
_READ_BYTES: Final = 3
"""Address, register, address again of a read on I2C."""


class LineUse(msgspec.Struct, frozen=True):
    """What one driver asks of one line."""

    device: str
    bit_s: float
    capacity_bit_s: float
    """What the line carries, unless it is configured; 0: not known."""
    shared: bool = False
    """Whether other drivers may use it, too: a bus."""


def serial_use(device: str, baud: int, bytes_s: float) -> LineUse:
    """A serial line, by the bytes a second of its busier direction."""
    return LineUse(device, bytes_s * SERIAL_BITS, float(baud))


def register_use(bus: str, device: str, speed_hz: int, reads: Iterable[int], rate_hz: float) -> LineUse:
    """Reads of a number of registers each, at a rate, on I2C or SPI."""
    counts = list(reads)
    if bus == "i2c":
        return LineUse(
            device, sum(_READ_BYTES + n for n in counts) * I2C_BITS * rate_hz, I2C_BIT_S, shared=True
        )
    return LineUse(device, sum(1 + n for n in counts) * 8 * rate_hz, float(speed_hz), shared=True)


def can_use(device: str, frames: Iterable[tuple[int, float]]) -> LineUse:
    """Frames with extended identifiers: bytes of data of each, and how often a second.

    Source: Davis, Burns, Bril, Lukkien 2007, "Controller Area Network (CAN) schedulability analysis",
    Real-Time Systems 35: the longest frame with stuffed bits.
    """
    bit_s = sum((67 + 8 * size + (53 + 8 * size) // 4) * rate_hz for size, rate_hz in frames)
    return LineUse(device, bit_s, CAN_BIT_S, shared=True)


def line_loads(uses: Iterable[tuple[str, LineUse]], capacities: Mapping[str, float]) -> tuple[LineLoad, ...]:
    """The load of each line, by the names of drivers and their uses; `capacities` are those configured."""
    by_device: dict[str, list[tuple[str, LineUse]]] = {}
    for driver, use in uses:
        by_device.setdefault(use.device, []).append((driver, use))
    return tuple(
        LineLoad(
            device,
            tuple(sorted({driver for driver, _ in found})),
            round(sum(use.bit_s for _, use in found), 1),
            capacities.get(device, min(use.capacity_bit_s for _, use in found)),
        )
        for device, found in sorted(by_device.items())
    )


def crowded(uses: Iterable[tuple[str, LineUse]]) -> tuple[str, str, str] | None:
    """A line that only one driver can have, and two that want it; None: there is none."""
    owners: dict[str, tuple[str, bool]] = {}
    for driver, use in uses:
        former = owners.setdefault(use.device, (driver, use.shared))
        if former[0] != driver and not (former[1] and use.shared):
            return use.device, former[0], driver
    return None


def is_over(load: LineLoad) -> bool:
    """Whether drivers ask more of a line than it carries without delay."""
    return load.capacity_bit_s > 0 and load.asked_bit_s > CAPACITY_RATIO * load.capacity_bit_s
