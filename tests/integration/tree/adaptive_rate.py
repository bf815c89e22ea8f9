"""A stream between two nodes over a loopback that falls from 5 to 0.5 Mbit/s and recovers.

Run as root from the folder of the sources: `PYTHONPATH=. unshare --net python
tests/integration/tree/adaptive_rate.py --rate auto`, or `--rate default`.
Written are 1.6 Mbit/s in items of 1 kB; prints for each second what arrived, its age, and the rate shown.
"""

import argparse
import asyncio
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Final

import uvloop
from tests.integration.tree.pair import platforms
from tests.patience import PATIENCE_S

from swarmware.types.channel import (
    RATE_MAX_HZ,
    ChannelLimits,
    ChannelSettings,
    ChannelStates,
    ListChannels,
    SetChannel,
)
from swarmware.types.scalar import Blob

FAST_BIT_S: Final = 5_000_000
SLOW_BIT_S: Final = 500_000
ITEM_BYTES: Final = 1000
PERIOD_S: Final = 0.005
PATH: Final = "map/scan"
FALL_S, RISE_S, END_S = 5, 15, 24
"""Instants after the start."""


def set_rate(verb: str, rate_bit_s: int) -> None:
    """Queue of 64 kB before the rate, as in `swarmctl lab link --rate`."""
    slow = f"tbf rate {rate_bit_s} burst 4kb limit 64kb"
    subprocess.run(["tc", "qdisc", verb, "dev", "lo", "root", *slow.split()], check=True)


async def measure(root: Path, rate: str) -> None:
    async with platforms(root, "uav1", "gcs") as (uav, gcs):
        writer = uav.probe.stream_writer(PATH, Blob, slots=256, slot_bytes=2048)
        reader = gcs.probe.stream_reader(f"/uav1/{PATH}", Blob)
        if rate == "auto":
            request = SetChannel(PATH, ChannelSettings(RATE_MAX_HZ, adaptive=True), link="gcs")
            await uav.probe.request("sys/broker/set_channel", request, ChannelLimits, timeout_s=PATIENCE_S)
        ages_ms: list[float] = []
        begun = asyncio.Event()

        async def write() -> None:
            async for _ in uav.probe.every(PERIOD_S):
                writer.write(Blob(time.monotonic_ns().to_bytes(8) + bytes(ITEM_BYTES - 8)))

        async def read() -> None:
            async for one in reader:
                begun.set()
                age_ms = (time.monotonic_ns() - int.from_bytes(one.value[:8])) / 1e6
                ages_ms.append(age_ms)

        uav.probe.start(write(), "write")
        gcs.probe.start(read(), "read")
        await begun.wait()
        print(" s | items | oldest ms | median ms | held back | rate Hz | reason")
        for second in range(END_S):
            ages_ms.clear()
            if second in (FALL_S, RISE_S):
                set_rate("change", SLOW_BIT_S if second == FALL_S else FAST_BIT_S)
            await asyncio.sleep(1.0)
            came = sorted(ages_ms)
            states = await uav.probe.request(
                "sys/tree/channels", ListChannels(), ChannelStates, timeout_s=PATIENCE_S
            )
            state = next((one for one in states.channels if one.path == PATH), None)
            held, hz, reason = (
                (0, None, "") if state is None else (state.held_back, state.rate_hz, state.reason)
            )
            oldest, median = (came[-1], came[len(came) // 2]) if came else (0.0, 0.0)
            limit = "" if hz is None else f"{hz:.1f}"
            row = f"{second:2} | {len(came):5} | {oldest:9.0f} | {median:9.0f} | {held:9} | {limit:>7}"
            print(f"{row} | {reason}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate", choices=["auto", "default"], default="auto")
    options = parser.parse_args()
    subprocess.run(["ip", "link", "set", "lo", "mtu", "1500", "up"], check=True)
    set_rate("add", FAST_BIT_S)
    with (
        tempfile.TemporaryDirectory(prefix="sw") as folder,
        asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner,
    ):
        runner.run(measure(Path(folder), options.rate))
