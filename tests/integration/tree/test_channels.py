"""Channels of two real nodes: what an operator sets holds at both ends, and is taken back and recorded."""

import asyncio
import contextlib
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest
from tests.integration.tree.pair import Platform, on_uvloop, platforms, until
from tests.patience import PATIENCE_S

from swarmware.errors import InvalidInput
from swarmware.module.board import BoardReader
from swarmware.module.stream import StreamReader
from swarmware.types.channel import (
    RATE_MAX_HZ,
    ChannelLimits,
    ChannelProtocol,
    ChannelSettings,
    ChannelState,
    ChannelStates,
    ListChannels,
    SetChannel,
    UndoChannel,
)
from swarmware.types.scalar import Blob, Float
from swarmware.types.tree import TreeChange, TreeEntry

PACKETS = Path(__file__).parents[3] / "share/swarm/data/vlp16/recording.bin"
PATH = "sensor/lidar"
SLOW = ChannelSettings(10.0, compression="zstd:1", buffer_bytes=2_000_000, buffer_s=30.0)
AUTO = ChannelSettings(RATE_MAX_HZ, adaptive=True)
S = 1_000_000_000


async def ask(gcs: Platform, verb: str, request: SetChannel | UndoChannel) -> ChannelLimits:
    return await gcs.probe.request(f"/uav1/sys/broker/{verb}", request, ChannelLimits, timeout_s=PATIENCE_S)


async def collect(reader: StreamReader[Blob], until_ns: int) -> list[tuple[int, bytes]]:
    """Stamps and payloads up to the first item that was written after an instant of the owner."""
    found: list[tuple[int, bytes]] = []
    async with asyncio.timeout(PATIENCE_S):
        async for packet in reader:
            assert reader.meta is not None
            found.append((reader.meta.stamp_ns, packet.value))
            if reader.meta.stamp_ns > until_ns:
                return found
    raise AssertionError("the stream ended")


@on_uvloop
async def test_rate_and_compression_hold_and_are_reset(
    tmp_path: Path,
) -> None:
    data = PACKETS.read_bytes()
    packets = [data[at : at + 1206] for at in range(0, len(data), 1206)]
    async with platforms(tmp_path, "uav1", "gcs") as (uav, gcs):
        writer = uav.probe.stream_writer(PATH, Blob, slots=256, slot_bytes=2048)
        reader = gcs.probe.stream_reader(f"/uav1/{PATH}", Blob)
        changes = uav.probe.stream_reader("tree/changes", TreeChange)

        async def write() -> None:
            count = 0
            async for _ in uav.probe.every(0.01):
                writer.write(Blob(packets[count % len(packets)]))
                count += 1

        writing = asyncio.create_task(write(), name="writer of packets")
        try:
            await collect(reader, 0)  # the subscription is in force
            before = await collect(reader, uav.probe.now_ns() + S)
            assert len(before) > 3 * 10

            answer = await ask(gcs, "set_channel", SetChannel("sensor/*", SLOW, link="gcs"))
            set_ns = uav.probe.now_ns()
            assert [rule.settings for rule in answer.limits] == [SLOW]
            limited = await collect(reader, set_ns + 3 * S)
            stamps = [stamp_ns for stamp_ns, _ in limited if stamp_ns > set_ns + S]
            assert len(stamps) > 10
            # by due time to due time: a writer that was late makes one interval shorter, not the rate larger
            assert len(stamps) <= (stamps[-1] - stamps[0]) / (S / 10) + 2
            assert {payload for _, payload in limited} <= set(packets), "bit for bit"
            states = await gcs.probe.request(
                "/uav1/sys/tree/channels", ListChannels(), ChannelStates, timeout_s=PATIENCE_S
            )
            [channel] = [one for one in states.channels if one.path == PATH]
            assert isinstance(channel, ChannelState)
            assert (channel.path, channel.link, channel.settings, channel.dropped) == (PATH, "gcs", SLOW, 0)
            assert channel.held_back > 10 * len(stamps) / 2
            [compression] = states.compressions
            assert 0 < compression.coded_bytes < 0.6 * compression.plain_bytes

            answer = await ask(gcs, "undo_channel", UndoChannel())
            undone_ns = uav.probe.now_ns()
            assert answer.limits == ()
            after = [s for s, _ in await collect(reader, undone_ns + 2 * S) if s > undone_ns + S]
            assert len(after) > 3 * 10, "more than the limit has let through"
            await ask(gcs, "set_channel", SetChannel("sensor/*", AUTO, link="gcs"))
            followed_ns = uav.probe.now_ns()
            assert await collect(reader, followed_ns + S // 2)
            states = await gcs.probe.request(
                "/uav1/sys/tree/channels", ListChannels(), ChannelStates, timeout_s=PATIENCE_S
            )
            [channel] = [one for one in states.channels if one.path == PATH]
            assert channel.settings == AUTO
            assert channel.reason, "what the link carries"
            await ask(gcs, "set_channel", SetChannel("sensor/*", ChannelSettings(20.0), for_s=0.1))
        finally:
            writing.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await writing
        async with asyncio.timeout(PATIENCE_S):
            first, second, auto, third, over = [await anext(changes) for _ in range(5)]
        assert first.by.endswith("@gcs")
        assert "sensor/* --link gcs --rate 10hz" in first.after
        assert second.before == first.after
        assert second.after == "no rule"
        assert auto.after == "sensor/* --link gcs --rate auto"
        assert third.before == "no rule"
        for text in (third.after, over.before):
            assert text.startswith("sensor/* --rate 20hz --for 0."), text
        assert (over.by, over.after) == ("broker@uav1", "no rule"), "its time was over"


def _travels(link: str, entry: TreeEntry | None) -> bool:
    return entry is not None and entry.link == link


def _is(expected: float, value: Float) -> bool:
    return value.value == expected


def _value(reader: BoardReader[Float]) -> float:
    assert reader.value is not None
    return reader.value.value


@on_uvloop
async def test_board_changes_between_beacon_and_notification(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "gcs") as (uav, gcs):
        board = uav.probe.writer("power/fuel", Float)
        fuel = gcs.probe.reader("/uav1/power/fuel", Float)
        board.write(Float(1.0))
        await until(fuel, lambda value: value.value == 1.0)
        await gcs.until_listed("/uav1/power/fuel", lambda entry: entry is not None and entry.link == "notify")
        beacon = (ChannelProtocol.UDP, "tick")
        for protocol, link in (beacon, (ChannelProtocol.ZMQ, "notify"), beacon):
            await ask(gcs, "set_channel", SetChannel("power/*", ChannelSettings(protocol=protocol)))
            await gcs.until_listed("/uav1/power/fuel", partial(_travels, link))
            board.write(Float(value := _value(fuel) + 1))
            await until(fuel, partial(_is, value))


@on_uvloop
async def test_unlimited_resource_refuses_limit_and_records_it(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "gcs") as (uav, gcs):
        changes = uav.probe.stream_reader("tree/changes", TreeChange)
        uav.probe.stream_writer("health/notes", Blob, kind="event")
        with pytest.raises(InvalidInput, match="each message is delivered"):
            await ask(gcs, "set_channel", SetChannel("sys/tree/get", ChannelSettings(1.0)))
        async with asyncio.timeout(PATIENCE_S):
            refused = await anext(changes)
        assert "each message is delivered" in refused.refused
        assert refused.by.endswith("@gcs")
        with pytest.raises(InvalidInput, match="JPEG is for values of type Image"):
            await ask(gcs, "set_channel", SetChannel("health/notes", ChannelSettings(compression="jpeg")))


@on_uvloop
async def test_buffered_board_delivers_values_of_outage_in_order(
    tmp_path: Path,
) -> None:
    groups = (("broker",), ("tree", "register"))
    async with platforms(tmp_path, "uav1", "gcs", services=groups) as (uav, gcs):
        board = uav.probe.writer("power/fuel", Float)
        fuel, history = (
            gcs.probe.reader("/uav1/power/fuel", Float),
            gcs.probe.history("/uav1/power/fuel", Float),
        )
        board.write(Float(0.0))
        await until(fuel, partial(_is, 0.0))
        await ask(gcs, "set_channel", SetChannel("power/*", ChannelSettings(buffer_s=60.0), link="gcs"))

        async def waiting() -> int:
            states = await uav.probe.request(
                "sys/tree/channels", ListChannels(), ChannelStates, timeout_s=PATIENCE_S
            )
            return max((channel.waiting for channel in states.channels), default=0)

        await gcs.end("broker")
        written = 0.0
        async with asyncio.timeout(PATIENCE_S):
            async for _ in uav.probe.every(0.05):
                written += 1
                board.write(Float(written))
                if await waiting() > 20:
                    break
        await gcs.start("broker")
        arrived: list[float] = []
        newest = 0.0
        async with asyncio.timeout(PATIENCE_S):
            # of the twenty, those that were under way at the end of the broker may have come before
            while written not in arrived or len(_former(arrived)) < 15:
                arrived.append((await history.next()).value)
                assert _value(fuel) >= newest, "the board does not go back"
                newest = _value(fuel)
        assert newest == written
        assert len(arrived) == len(set(arrived)), "each once"
        # the last one may come after them: it waits while the one before is under way
        former = _former(arrived)
        assert sum(later > sooner for sooner, later in pairwise(former)) <= 1, (
            "newest first but what was under way"
        )
        assert max(former) in former[:2]


def _former(arrived: list[float]) -> list[float]:
    """Values that arrived after a newer one."""
    return [value for at, value in enumerate(arrived) if value < max(arrived[:at], default=value)]
