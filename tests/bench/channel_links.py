"""A recorded lidar on the radio, and what rules of its channel do: rate, outage, buffer.

    python tests/bench/channel_links.py [--seconds N] [--lab NAME] [--json]

Three nodes in namespaces with the radio `s3` (`swarmctl lab up --net netns`), all their daemons running. A
vehicle has the packets of a VLP-16, 753 of 1206 bytes a second, as a stream; an application at `gcs` reads
it. First without any rule. Then with 50 Hz: how soon that holds at the reader; then over an outage of 5 s
with room for it, and over one of 8 s with room for 3 s. Needs the rights of `--net netns`.
"""

import asyncio
import itertools
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

from msgspec import Struct

sys.path.insert(0, str(Path(__file__).parents[2]))
from lab import options, radio_lab
from rows import Row, print_rows

from swarmctl.session.labs import LabState
from swarmlab.radio.orders import CutLinks, HealLinks, Links, send
from swarmware.model import names
from swarmware.module.module import Module
from swarmware.module.stream import StreamReader
from swarmware.types.channel import (
    ChannelLimits,
    ChannelSettings,
    ChannelStates,
    ClearChannels,
    ListChannels,
    SetChannel,
)
from swarmware.types.scalar import Blob

R = TypeVar("R", bound=Struct)

OWN: Final = "bench-channels"
OWNER: Final = "ugv1"
READER: Final = "gcs"
STREAM: Final = "sensor/lidar"
PACKETS_HZ: Final = 753.0
RATE_HZ: Final = 50.0
BUFFER_BYTES: Final = 2_000_000
SHORT_S: Final = 5.0
LONG_S: Final = 8.0
ROOM_S: Final = 3.0
PATIENCE_S: Final = 60.0
CURRENT_S: Final = 0.5
"""Age of an item from which the stream is current again."""


class Arrival(NamedTuple):
    """One item at the reader."""

    at_s: float
    stamp_ns: int
    age_s: float
    lost: int
    """Items reported to the reader as missing so far."""


class Lidar:
    """The stream at the reader, and requests to its owner."""

    def __init__(self, lab: LabState, module: Module) -> None:
        self._lab = lab
        self._module = module
        self._reader: StreamReader[Blob] = module.stream_reader(names.join(OWNER, STREAM), Blob)
        self.arrivals: list[Arrival] = []
        self._came = asyncio.Event()
        self.fresh_s = 0.0
        """Smallest age: the clocks of the nodes differ."""

    @property
    def lost(self) -> int:
        """Items reported to the reader as missing."""
        return self._reader.lost

    async def follow(self) -> None:
        """Notes each item."""
        async for _ in self._reader:
            meta = self._reader.meta
            assert meta is not None
            age_s = (self._module.now_ns() - meta.stamp_ns) / 1e9
            self.arrivals.append(Arrival(time.monotonic(), meta.stamp_ns, age_s, self.lost))
            self._came.set()

    async def ask(self, path: str, request: Struct, reply: type[R]) -> R:
        """A request to the owner."""
        return await self._module.request(names.join(OWNER, path), request, reply)

    async def set(self, settings: ChannelSettings) -> float:
        """Sets the channel; the instant of the request."""
        asked_s = time.monotonic()
        await self.ask("sys/broker/set_channel", SetChannel(STREAM, settings), ChannelLimits)
        return asked_s

    async def counted(self) -> tuple[int, int]:
        """Items that the owner counts as dropped, and as left out by the rate."""
        states = await self.ask("sys/tree/channels", ListChannels(), ChannelStates)
        found = [one for one in states.channels if one.path == STREAM and one.link == READER]
        return sum(one.dropped for one in found), sum(one.held_back for one in found)

    async def outage(self, seconds: float) -> float:
        """Cuts the owner off for that time; the instant of its return."""
        others = [node.platform for node in self._lab.nodes if node.platform != OWNER]
        links: Links = tuple(pair for other in others for pair in ((OWNER, other), (other, OWNER)))
        folder = Path(self._lab.folder)
        await asyncio.to_thread(send, folder, CutLinks(links))
        await asyncio.sleep(seconds)
        await asyncio.to_thread(send, folder, HealLinks(links))
        return time.monotonic()

    async def current(self, since_s: float) -> float:
        """Waits until the newest item is current; the time since that instant."""
        async with asyncio.timeout(PATIENCE_S):
            newest = self.arrivals[-1]
            while newest.at_s <= since_s or newest.age_s - self.fresh_s >= CURRENT_S:
                self._came.clear()
                await self._came.wait()
                newest = self.arrivals[-1]
        return time.monotonic() - since_s

    async def begun(self, items: int) -> None:
        """Waits for a number of items, after which the subscription is in force."""
        async with asyncio.timeout(PATIENCE_S):
            while len(self.arrivals) < items:
                self._came.clear()
                await self._came.wait()

    def stamps(self, since: int) -> list[int]:
        """Stamps of the items since that index."""
        return [one.stamp_ns for one in self.arrivals[since:]]


async def plain(lidar: Lidar, seconds: float) -> Row:
    """The whole stream, without a rule."""
    await lidar.begun(round(2 * PACKETS_HZ))
    start, lost = len(lidar.arrivals), lidar.lost
    dropped, _ = await lidar.counted()
    await asyncio.sleep(seconds)
    stamps = lidar.stamps(start)
    expected = round((stamps[-1] - stamps[0]) / 1e9 * PACKETS_HZ) + 1
    missing, told = expected - len(stamps), lidar.lost - lost
    counted = (await lidar.counted())[0] - dropped
    ages = sorted(one.age_s for one in lidar.arrivals[start:])
    lidar.fresh_s = ages[0]
    late_s = ages[len(ages) * 99 // 100] - ages[0]
    return Row(
        "real VLP-16 stream, 753 packets/s, to another node",
        f"{len(stamps)} packets, {missing} missing (reported to the reader {told}, to the owner {counted});"
        f" {'in order' if stamps == sorted(stamps) else 'out of order'}; age p99 {late_s:.2f} s",
        "none missing, or gaps reported at both ends",
        stamps == sorted(stamps) and (missing == 0 or missing <= told == counted),
    )


async def effect(lidar: Lidar) -> Row:
    """How soon a rate holds at the reader."""
    asked_s = await lidar.set(ChannelSettings(max_hz=RATE_HZ, buffer_bytes=BUFFER_BYTES, buffer_s=30.0))
    answered_s = time.monotonic()
    await asyncio.sleep(5)
    late = max(
        (
            after.at_s
            for before, after in itertools.pairwise(lidar.arrivals)
            if after.at_s > asked_s and after.stamp_ns - before.stamp_ns < 0.9e9 / RATE_HZ
        ),
        default=asked_s,
    )
    start = next(index for index, one in enumerate(lidar.arrivals) if one.at_s > late)
    stamps = lidar.stamps(start)
    rate_hz = (len(stamps) - 1) / ((stamps[-1] - stamps[0]) / 1e9)
    return Row(
        "`traffic set --rate 50hz` on that stream",
        f"answer {answered_s - asked_s:.2f} s, last packet above the rate {late - asked_s:.2f} s after the"
        f" request; then {rate_hz:.1f} /s",
        "both ends ≤ 1 s",
        max(late, answered_s) - asked_s <= 1.0 and abs(rate_hz - RATE_HZ) < 1,
    )


async def drained(lidar: Lidar) -> Row:
    """An outage for which the buffer has room."""
    start, dropped = len(lidar.arrivals), (await lidar.counted())[0]
    back_s = await lidar.outage(SHORT_S)
    took_s = await lidar.current(back_s)
    stamps = lidar.stamps(start)
    gaps = [(after - before) / 1e9 for before, after in itertools.pairwise(stamps)]
    missing = sum(max(0, round(gap * RATE_HZ) - 1) for gap in gaps)
    arrived = [one for one in lidar.arrivals[start:] if one.at_s > back_s]
    first_s = arrived[0].at_s - back_s
    pace_hz = (len(arrived) - 1) / (arrived[-1].at_s - arrived[0].at_s)
    return Row(
        f"that channel over an outage of {SHORT_S:g} s, buffer 2 MB / 30 s",
        f"{missing} missing, {'in order' if stamps == sorted(stamps) else 'out of order'};"
        f" first after {first_s:.2f} s, current after {took_s:.1f} s at {pace_hz:.0f} /s",
        "none missing, in order, paced",
        missing == 0
        and (await lidar.counted())[0] == dropped
        and stamps == sorted(stamps)
        and pace_hz < 4 * RATE_HZ,
    )


async def shortened(lidar: Lidar) -> Row:
    """An outage that is longer than what may wait."""
    await lidar.set(ChannelSettings(buffer_s=ROOM_S))
    before, start = (await lidar.counted())[0], len(lidar.arrivals)
    back_s = await lidar.outage(LONG_S)
    took_s = await lidar.current(back_s)
    counted = (await lidar.counted())[0] - before
    gap_ns, told = max(
        (other.stamp_ns - one.stamp_ns, other.lost - one.lost)
        for one, other in itertools.pairwise(lidar.arrivals[start:])
    )
    missing = round(gap_ns / 1e9 * RATE_HZ) - 1
    numbers = round(gap_ns / 1e9 * PACKETS_HZ) - 1
    return Row(
        f"that channel over an outage of {LONG_S:g} s, buffer 3 s",
        f"one gap of {gap_ns / 1e9:.2f} s: {missing} of that rate missing, {counted} counted by the owner;"
        f" reported to the reader: {told} of {numbers} numbers; current after {took_s:.1f} s",
        "the oldest dropped, reported at both ends",
        missing > 0 and abs(counted - missing) <= 1 and abs(told - numbers) <= numbers / 100,
    )


async def rows(lab: LabState, seconds: float) -> list[Row]:
    """All cases, one after the other."""
    async with Module("bench", config_dir=lab.node(READER).config_dir) as module:
        lidar = Lidar(lab, module)
        module.start(lidar.follow(), "follow")
        found = [await plain(lidar, seconds), await effect(lidar), await drained(lidar)]
        found.append(await shortened(lidar))
        await lidar.ask("sys/broker/clear_channels", ClearChannels(), ChannelLimits)
        return found


def measured(lab: LabState, seconds: float) -> Iterator[Row]:
    """The rows of a lab."""
    yield from asyncio.run(rows(lab, seconds))


def main() -> int:
    """Measures and prints."""
    parser = options(__doc__)
    parser.add_argument("--seconds", type=float, default=30.0)
    given = parser.parse_args()
    with radio_lab(given.lab, OWN, nodes=3, radio="s3") as lab:
        print_rows(measured(lab, given.seconds), as_json=given.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
