"""Load of the lines and buses by their drivers, compared with the capacity (S1.17)."""

from collections.abc import Iterable, Mapping
from typing import Final

import msgspec

from swarmware.types.driver import LineLoad

CAPACITY_RATIO: Final = 0.8
"""Ratio of load to capacity above which values wait; equal to the ratio for cores in `doctor placement`."""
I2C_BIT_S: Final = 100_000.0
"""Rate of I2C in standard mode, unless another rate is configured. Source: NXP UM10204."""
CAN_BIT_S: Final = 500_000.0
"""Rate of CAN in the manual of the drivers, unless another rate is configured."""
SERIAL_BITS: Final = 10
"""Bits per byte on a serial line: start bit, eight data bits, stop bit."""
I2C_BITS: Final = 9
"""Bits per byte on I2C: eight data bits and the acknowledgement."""
_READ_BYTES: Final = 3
"""Overhead of a read on I2C: address, register, and address again."""


class LineUse(msgspec.Struct, frozen=True):
    """Load of one line by one driver."""

    device: str
    bit_s: float
    capacity_bit_s: float
    """Capacity of the line unless configured, or 0 if unknown."""
    shared: bool = False
    """True for a bus, which other drivers may use as well."""


def serial_use(device: str, baud: int, bytes_s: float) -> LineUse:
    """Load of a serial line, from the bytes per second in its busier direction."""
    return LineUse(device, bytes_s * SERIAL_BITS, float(baud))


def register_use(bus: str, device: str, speed_hz: int, reads: Iterable[int], rate_hz: float) -> LineUse:
    """Load of I2C or SPI by reads at a rate; `reads` are the numbers of registers of each read."""
    counts = list(reads)
    if bus == "i2c":
        return LineUse(
            device, sum(_READ_BYTES + n for n in counts) * I2C_BITS * rate_hz, I2C_BIT_S, shared=True
        )
    return LineUse(device, sum(1 + n for n in counts) * 8 * rate_hz, float(speed_hz), shared=True)


def can_use(device: str, frames: Iterable[tuple[int, float]]) -> LineUse:
    """Load of CAN by extended frames, given as pairs of data bytes and rate.

    Source: Davis, Burns, Bril, Lukkien 2007, "Controller Area Network (CAN) schedulability analysis",
    Real-Time Systems 35: the longest frame with stuffed bits.
    """
    bit_s = sum((67 + 8 * size + (53 + 8 * size) // 4) * rate_hz for size, rate_hz in frames)
    return LineUse(device, bit_s, CAN_BIT_S, shared=True)


def line_loads(uses: Iterable[tuple[str, LineUse]], capacities: Mapping[str, float]) -> tuple[LineLoad, ...]:
    """Load of each line, from uses by drivers; `capacities` are configured and have precedence."""
    by_device: dict[str, list[tuple[str, LineUse]]] = {}
    for driver, use in uses:
        by_device.setdefault(use.device, []).append((driver, use))
    return tuple(
        LineLoad(
            device,
            tuple(sorted({driver for driver, _ in found})),
            round(sum(use.bit_s for _, use in found), 1),
            # the slowest driver sets the rate of a bus that several share
            capacities.get(device, min(use.capacity_bit_s for _, use in found)),
        )
        for device, found in sorted(by_device.items())
    )


def crowded(uses: Iterable[tuple[str, LineUse]]) -> tuple[str, str, str] | None:
    """Line that only one driver can use, and two drivers that use it, or None without such a conflict."""
    owners: dict[str, tuple[str, bool]] = {}
    for driver, use in uses:
        # buses may be shared, serial lines may not
        former = owners.setdefault(use.device, (driver, use.shared))
        if former[0] != driver and not (former[1] and use.shared):
            return use.device, former[0], driver
    return None


def is_over(load: LineLoad) -> bool:
    """True if the load of a line exceeds the capacity without delay."""
    return load.capacity_bit_s > 0 and load.asked_bit_s > CAPACITY_RATIO * load.capacity_bit_s
