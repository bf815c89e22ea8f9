"""Sixteen drivers at their own rates, one of them an inertial unit of 300 Hz, beside a bare timer loop.

Lateness: from the instant at which a driver is due to its call. The bare loop has one task without work; it
runs three times before the drivers and once after them, and the ratio, to the last one, is refused if that is
more than 20 % above the best of the three.
"""

import argparse
import asyncio
import json
import os
import tempfile
import threading
import time
from collections.abc import Iterable
from pathlib import Path
from unittest.mock import patch

import uvloop
from rows import AT_START, REFUSED, Bare

from swarmd.hal.blocking import BlockingSensor
from swarmd.hal.config import Config
from swarmd.hal.driver import Actuator, Device, Sensor
from swarmd.hal.service import Hal
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.vehicle import Imu

RATES_HZ = (300, 100, 100, 100, 100, 100, 50, 50, 40, 20, 20, 20, 10, 10, 5, 1)
REFERENCE_HZ = 100
VALUE = Imu(0.0, 0.0, 0.0, 0.0, 0.0, 9.81)


class Lateness:
    """Lateness of calls that are due at multiples of a period."""

    def __init__(self, rate_hz: int) -> None:
        self.rate_hz = rate_hz
        self.period_ns = round(1e9 / rate_hz)
        self.late_ns: list[int] = []

    def note(self, now_ns: int) -> None:
        self.late_ns.append(now_ns % self.period_ns)

    def percentile_ms(self, share: float) -> float:
        ordered = sorted(self.late_ns[5:])  # not the first ones, while devices are opened
        return ordered[int(share * (len(ordered) - 1))] / 1e6


class Rated(Sensor):
    """A sensor that writes a board, as a real one does."""

    def __init__(self, number: int, rate_hz: int) -> None:
        self.name, self.period_s = f"d{number}", 1 / rate_hz
        self.lateness = Lateness(rate_hz)
        self._writer: BoardWriter[Imu] | None = None

    async def open(self, module: Module) -> None:
        self._writer = module.writer(f"sensor/{self.name}", Imu)

    async def read(self, now_ns: int) -> bool:
        self.lateness.note(now_ns)
        assert self._writer is not None
        self._writer.write(VALUE, now_ns)
        return True


class Blocks(BlockingSensor[int]):
    """A device whose answer takes a millisecond, in a thread of its own."""

    def __init__(self, number: int, rate_hz: int) -> None:
        self.name, self.period_s = f"d{number}", 1 / rate_hz
        self.lateness = Lateness(rate_hz)

    def measure(self) -> int:
        threading.Event().wait(0.001)
        return 1

    def publish(self, value: int, now_ns: int) -> bool:
        self.lateness.note(now_ns)
        return True


class Writes(Actuator):
    """An actuator that takes what it gets."""

    def __init__(self, number: int, rate_hz: int) -> None:
        self.name, self.period_s = f"d{number}", 1 / rate_hz
        self.lateness = Lateness(rate_hz)

    async def write(self, now_ns: int) -> bool:
        self.lateness.note(now_ns)
        return True

    def failsafe(self, now_ns: int) -> str:
        return ""


def drivers() -> list[Rated | Blocks | Writes]:
    kinds = (Rated, Rated, Blocks, Writes)
    return [kinds[number % len(kinds)](number, rate_hz) for number, rate_hz in enumerate(RATES_HZ)]


async def bare(duration_s: float) -> Lateness:
    found, end = Lateness(REFERENCE_HZ), time.monotonic() + duration_s
    while time.monotonic() < end:
        now_ns = time.monotonic_ns()
        due_ns = now_ns - now_ns % found.period_ns + found.period_ns
        await asyncio.sleep((due_ns - now_ns) / 1e9)
        found.late_ns.append(max(0, time.monotonic_ns() - due_ns))
    return found


async def loaded(duration_s: float) -> tuple[list[Lateness], float]:
    devices = drivers()
    given: Iterable[Device] = devices
    with tempfile.TemporaryDirectory() as folder:
        async with tmp_node(Path(folder)) as node, Module("hal", node=node) as module:
            with patch("swarmd.hal.service.make_all", return_value=list(given)):
                task = asyncio.create_task(Hal(module, Config(drivers=())).run())
                began, cpu = time.monotonic(), time.process_time()
                await asyncio.sleep(duration_s)
                used = (time.process_time() - cpu) / (time.monotonic() - began)
                task.cancel()
                await asyncio.wait([task])
    return [device.lateness for device in devices], used


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # one core, as on a small computer
    bare_s = args.seconds / (AT_START + 1)
    reference = Bare.measured(lambda: uvloop.run(bare(bare_s)).percentile_ms(0.99))
    found, used = uvloop.run(loaded(args.seconds))
    beside_ms = uvloop.run(bare(bare_s)).percentile_ms(0.99)
    at_100 = Lateness(REFERENCE_HZ)
    for one in found:
        if one.rate_hz == REFERENCE_HZ:
            at_100.late_ns += one.late_ns[5:]
    fastest = found[0]
    figures: dict[str, float | str] = {
        "bare_p99_ms": round(beside_ms, 3),
        "p99_ms_at_100_hz": round(at_100.percentile_ms(0.99), 3),
        "imu_hz": round(len(fastest.late_ns) / args.seconds, 1),
        "imu_p99_ms": round(fastest.percentile_ms(0.99), 3),
        "core_ratio": round(used, 3),
    }
    figures["ratio"] = round(at_100.percentile_ms(0.99) / beside_ms, 2)
    refusal = reference.refusal(beside_ms)
    if refusal:
        figures["REFUSED"] = refusal
    lines = "\n".join(f"{key:18} {value}" for key, value in figures.items())
    print(json.dumps(figures) if args.json else lines)
    return REFUSED if refusal else 0


if __name__ == "__main__":
    raise SystemExit(main())
