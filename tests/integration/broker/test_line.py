"""Three brokers in a line: what goes over the middle, and what happens without it."""

import asyncio
from pathlib import Path

import pytest
from tests.integration.broker.swarm import LINE, Station, on_uvloop, swarm
from tests.patience import PATIENCE_S

from swarmd.broker.core.beacon.parts.beacon_signature import PART_BYTES
from swarmd.broker.core.frames.frame_datagram import FRAME_MAX
from swarmd.broker.core.swarm.links.link import PERFECT, RTT_PENALTY
from swarmware.errors import InvalidInput, NoAnswer, OutOfRange
from swarmware.model.frame import HEADER_BYTES, FrameKind
from swarmware.model.names import join
from swarmware.transport.delivery.outcome import ABSENT, FULL, Status
from swarmware.types.channel import ChannelLimits, ChannelSettings, SetChannel
from swarmware.types.scalar import Float, Text
from swarmware.types.time import TimingBatch
from swarmware.types.traffic import LinkTraffic, Traffic
from swarmware.types.vehicle import Pose

NAMES = ("uav1", "uav2", "uav3")


def serve_echo(station: Station) -> None:
    station.app.serve(
        "cmd/echo", Text, lambda request, _: Text(f"{station.platform}: {request.value}"), reply=Text
    )


@on_uvloop
async def test_request_reaches_other_end_and_is_answered(tmp_path: Path) -> None:
    async with swarm(tmp_path, *NAMES, hear=LINE) as line:
        serve_echo(line["uav3"])
        await line["uav1"].until_reaches(uav2="uav2", uav3="uav2")
        await line["uav3"].until_reaches(uav1="uav2")
        assert line["uav1"].states() == {"uav2": "up"}
        for text in ("hello", "again"):
            answer = await line["uav1"].app.request("/uav3/cmd/echo", Text(text), Text, timeout_s=PATIENCE_S)
            assert answer == Text(f"uav3: {text}")
        first, middle = await line["uav1"].traffic(), await line["uav2"].traffic()
        assert first.requests == 2
        assert middle.requests == 0
        # both requests and replies, and once each end's question and answer about its session
        assert middle.forwarded_frames == 2 * 2 + 4
        assert first.refused.spoofed == 0


@on_uvloop
async def test_frames_sent_together_leave_together(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        await pair["uav1"].until_up("uav2")
        serve_echo(pair["uav2"])
        app = pair["uav1"].app
        await app.request("/uav2/cmd/echo", Text("connected"), Text, timeout_s=PATIENCE_S)
        before = (await pair["uav1"].traffic()).sent_frames
        with app.node.messaging.batch(), app.node.messaging.batch():
            asked = [
                app.request("/uav2/cmd/echo", Text(f"{number}"), Text, timeout_s=PATIENCE_S)
                for number in range(3)
            ]
            assert (await pair["uav1"].traffic()).sent_frames == before
        assert [text.value for text in await asyncio.gather(*asked)] == [
            "uav2: 0",
            "uav2: 1",
            "uav2: 2",
        ]


def over_tcp(traffic: Traffic, platform: str) -> LinkTraffic:
    [found] = [one for one in traffic.links if (one.platform, one.transport) == (platform, "tcp")]
    return found


async def settled(one: Station, other: Station) -> tuple[Traffic, Traffic]:
    """The counters of both when each has received what the other has sent, in frames and bytes."""
    async with asyncio.timeout(PATIENCE_S):
        while True:  # what was under way when the first was asked is a frame more at the second
            here, there = await one.traffic(), await other.traffic()
            out, into = over_tcp(here, other.platform), over_tcp(there, one.platform)
            sent = (out.sent_frames, out.sent_bytes) == (into.received_frames, into.received_bytes)
            if sent and (out.received_frames, out.received_bytes) == (into.sent_frames, into.sent_bytes):
                return here, there


@on_uvloop
async def test_frames_are_counted_once_by_resource(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        for station in pair.values():
            station.app.inbox("plan/share", Text)
        await pair["uav1"].until_up("uav2")
        send = pair["uav1"].app.send
        for number in range(10):
            assert await send(
                "/uav2/plan/share", Text(str(number)), timeout_s=PATIENCE_S, kind=FrameKind.NOTIFY
            )
        before = await pair["uav1"].traffic()
        assert not await send("/uav9/plan/share", Text(""), timeout_s=0.5)
        here, there = await settled(pair["uav1"], pair["uav2"])
        assert here.sent_frames == before.sent_frames, "what found no way was not sent"
        [sent] = [one.sent_frames for one in here.channels if one.channel == "plan/share"]
        assert sent == here.sent_frames
        [received] = [one.received_frames for one in there.channels if one.channel == "plan/share"]
        assert received == there.received_frames
        assert there.notifications == 10, "a repetition is no other notification"
        out = over_tcp(here, "uav2")
        assert out.sent_bytes > out.sent_frames * HEADER_BYTES


@on_uvloop
async def test_message_over_two_hops_is_acknowledged_on_arrival(tmp_path: Path) -> None:
    async with swarm(tmp_path, *NAMES, hear=LINE) as line:
        box = line["uav3"].app.inbox("cmd/note", Text)
        await line["uav1"].until_reaches(uav3="uav2")
        await line["uav3"].until_reaches(uav1="uav2")
        for number in range(20):
            outcome = await line["uav1"].app.send("/uav3/cmd/note", Text(str(number)), timeout_s=PATIENCE_S)
            assert outcome.status is Status.DELIVERED, outcome
        assert [(await anext(box)).value for _ in range(20)] == [str(number) for number in range(20)]


@on_uvloop
async def test_sender_without_middle_learns_where_it_stopped(tmp_path: Path) -> None:
    async with swarm(tmp_path, *NAMES, hear=LINE) as line:
        await line["uav1"].until_reaches(uav3="uav2")
        await line["uav2"].stop()
        await line["uav1"].until_lost("uav3")
        await line["uav1"].until(lambda: line["uav1"].states() == {"uav2": "down"}, line["uav1"].neighbours)
        outcome = await line["uav1"].app.send("/uav3/cmd/note", Text("?"), timeout_s=0.5)
        assert (outcome.status, outcome.where) == (Status.UNREACHABLE, "uav1")
        assert "no route to uav3" in outcome.detail
        with pytest.raises(NoAnswer, match="no route to uav3"):
            await line["uav1"].app.request("/uav3/cmd/echo", Text(""), Text, timeout_s=0.5)


@on_uvloop
async def test_middle_reports_departed_far_end(tmp_path: Path) -> None:
    async with swarm(tmp_path, *NAMES, hear=LINE) as line:
        await line["uav1"].until_reaches(uav3="uav2")
        await line["uav3"].stop()
        await line["uav2"].until_lost("uav3")
        # whether or not uav1 knows of it, the message stops at a hop that is named
        outcome = await line["uav1"].app.send("/uav3/cmd/note", Text("?"), timeout_s=1.0)
        assert outcome.status is Status.UNREACHABLE
        assert outcome.where in {"uav1", "uav2"}


@on_uvloop
async def test_message_stopped_two_hops_away_names_that_hop(tmp_path: Path) -> None:
    async with swarm(tmp_path, *NAMES, hear=LINE) as line:
        app = line["uav1"].app
        box = line["uav3"].app.inbox("cmd/order", Text, limit=1)
        await line["uav1"].until_reaches(uav3="uav2")
        delivered = await app.send("/uav3/cmd/order", Text("first"), timeout_s=PATIENCE_S)
        assert (delivered.status, delivered.where) == (Status.DELIVERED, "uav3:app#1")
        full = await app.send("/uav3/cmd/order", Text("second"), timeout_s=1.0)
        assert (full.status, full.where, full.detail) == (Status.EXPIRED, "uav3", FULL)
        absent = await app.send("/uav3/cmd/none", Text("?"), timeout_s=4.0)
        assert (absent.status, absent.where, absent.detail) == (Status.REFUSED, "uav3", ABSENT)
        assert box.take() == Text("first")
        assert await app.send("/uav3/cmd/order", Text("third"), timeout_s=PATIENCE_S)


@on_uvloop
async def test_a_middle_that_comes_back_is_used_again(tmp_path: Path) -> None:
    async with swarm(tmp_path, *NAMES, hear=LINE) as line:
        serve_echo(line["uav3"])
        await line["uav1"].until_reaches(uav3="uav2")
        await line["uav2"].stop()
        await line["uav1"].until_lost("uav3")
        await line["uav2"].start()
        await line["uav1"].until_reaches(uav3="uav2")
        await line["uav3"].until_reaches(uav1="uav2")
        answer = await line["uav1"].app.request("/uav3/cmd/echo", Text("again"), Text, timeout_s=PATIENCE_S)
        assert answer == Text("uav3: again")


@on_uvloop
async def test_broker_that_restarts_at_once_is_neighbour_again(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        serve_echo(pair["uav2"])
        await pair["uav1"].until_up("uav2")
        await pair["uav1"].app.request("/uav2/cmd/echo", Text("1"), Text, timeout_s=PATIENCE_S)
        await pair["uav2"].stop()
        await pair["uav2"].start()
        await pair["uav2"].until_up("uav1")
        await pair["uav1"].until_up("uav2")
        answer = await pair["uav1"].app.request("/uav2/cmd/echo", Text("2"), Text, timeout_s=PATIENCE_S)
        assert answer == Text("uav2: 2")
        assert (await pair["uav1"].traffic()).refused.old_session == 0


@on_uvloop
async def test_boards_travel_over_middle_to_subscribers(tmp_path: Path) -> None:
    async with swarm(tmp_path, *NAMES, hear=LINE) as line:
        pose = line["uav1"].app.writer("nav/pose", Pose)
        mirror = line["uav3"].app.reader("/uav1/nav/pose", Pose)
        line["uav1"].plan(offers=[("nav/pose", Pose)])
        line["uav3"].plan(wants=[("uav1", "nav/pose", Pose)])
        pose.write(Pose.planar(1.0, 2.0, yaw_rad=0.5))
        first = await mirror.changed(PATIENCE_S)
        assert (first.x_m, first.y_m) == (1.0, 2.0)
        assert first.yaw_rad == pytest.approx(0.5, abs=1e-3)
        for step in range(10):
            pose.write(Pose.planar(10.0 + step, 0.0))
        async with asyncio.timeout(PATIENCE_S):
            while (await mirror.changed()).x_m != 19.0:
                pass
        assert mirror.stamp_ns is not None
        assert 0 <= line["uav1"].node.clock.now_ns() - mirror.stamp_ns < 10e9
        middle, end = await line["uav2"].traffic(), await line["uav3"].traffic()
        assert end.notifications >= 2
        assert middle.notifications == 0, "it passes on what it does not read itself"


@on_uvloop
async def test_nobody_relays_where_all_hear_each_other(tmp_path: Path) -> None:
    async with swarm(tmp_path, *NAMES) as cell:
        pose = cell["uav1"].app.writer("nav/pose", Pose)
        mirror = cell["uav3"].app.reader("/uav1/nav/pose", Pose)
        for one, station in cell.items():
            await station.until_up(*(other for other in NAMES if other != one))
        cell["uav1"].plan(offers=[("nav/pose", Pose)])
        cell["uav3"].plan(wants=[("uav1", "nav/pose", Pose)])
        for step in range(20):
            pose.write(Pose.planar(float(step), 0.0))
            await mirror.changed(PATIENCE_S)
        middle = next(link for link in (await cell["uav2"].traffic()).links if link.platform == "*")
        assert middle.sent_bytes / middle.sent_frames < 150 + PART_BYTES


@on_uvloop
async def test_value_older_than_its_subscription_arrives_too(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        level = pair["uav1"].app.writer("power/level", Float)
        level.write(Float(12.5))
        pair["uav1"].plan(offers=[("power/level", Float)])
        await pair["uav2"].until_up("uav1")
        reader = pair["uav2"].app.reader("/uav1/power/level", Float)
        pair["uav2"].plan(wants=[("uav1", "power/level", Float)])
        assert (await reader.changed(PATIENCE_S)).value == 12.5


@on_uvloop
async def test_new_rate_holds_within_second_and_is_shown(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        level = pair["uav1"].app.writer("power/level", Float)
        pair["uav1"].plan(offers=[("power/level", Float)])
        limits = await pair["uav1"].app.request(
            "sys/broker/set_channel",
            SetChannel("power/*", ChannelSettings(0.0)),
            ChannelLimits,
            timeout_s=PATIENCE_S,
        )
        assert [limit.pattern for limit in limits.limits] == ["power/*"]
        level.write(Float(1.0))

        def held(traffic: Traffic) -> bool:
            return any(
                c.channel == "power/level" and c.offered_frames == 1 and c.max_hz == 0.0
                for c in traffic.channels
            )

        traffic = await pair["uav1"].until_counted(held)
        assert [c.sent_frames for c in traffic.channels if c.channel == "power/level"] == [0]
        reader = pair["uav2"].app.reader("/uav1/power/level", Float)
        pair["uav2"].plan(wants=[("uav1", "power/level", Float)])
        await pair["uav1"].app.request(
            "sys/broker/set_channel", SetChannel("power/*"), ChannelLimits, timeout_s=PATIENCE_S
        )
        assert (await reader.changed(PATIENCE_S)).value == 1.0


@on_uvloop
async def test_a_limit_that_makes_no_sense_is_refused(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1") as one:
        request = one["uav1"].app.request
        with pytest.raises(OutOfRange, match=r"max_hz -1\.0"):
            await request("sys/broker/set_channel", SetChannel("**", ChannelSettings(-1.0)), ChannelLimits)
        with pytest.raises(OutOfRange, match="for_s"):
            await request(
                "sys/broker/set_channel", SetChannel("**", ChannelSettings(1.0), -5.0), ChannelLimits
            )
        with pytest.raises(InvalidInput):
            await request(
                "sys/broker/set_channel", SetChannel("Not a path", ChannelSettings(1.0)), ChannelLimits
            )


@on_uvloop
async def test_names_and_trees_are_known_over_two_hops(tmp_path: Path) -> None:
    async with swarm(tmp_path, *NAMES, hear=LINE, keys=False) as line:
        line["uav1"].plan(tree_version=0xBEEF)
        await line["uav3"].until_reaches(uav1="uav2")

        def knows() -> bool:
            table = line["uav3"].routes.value
            return table is not None and any(r.tree_version == 0xBEEF for r in table.routes)

        await line["uav3"].until(knows, line["uav3"].routes)


@on_uvloop
async def test_clock_differences_are_told_for_each_datagram(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        timing = pair["uav1"].app.stream_reader("net/timing", TimingBatch)
        async with asyncio.timeout(PATIENCE_S):
            async for batch in timing:
                sample = batch.samples[0]
                if sample.upper_ns is not None:
                    break
        # both clocks are this machine's: the true difference is 0 and must lie between the bounds
        assert (sample.platform, sample.unit) == ("uav2", "main")
        assert sample.lower_ns <= 1000
        assert sample.upper_ns is not None
        assert sample.upper_ns >= -1000
        assert sample.boot_id == pair["uav2"].node.clock.boot_id
        assert sample.sent_ns < sample.received_ns


@on_uvloop
async def test_own_boards_say_how_a_neighbour_is(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        await pair["uav1"].until_up("uav2")
        table = pair["uav1"].neighbours.value
        assert table is not None
        [other] = table.neighbours
        assert (other.platform, other.unit, other.kind, other.multicast) == ("uav2", "main", "uav", True)
        assert other.transport == "idle"

        def perfect() -> bool:
            table = pair["uav1"].neighbours.value
            # on a busy computer the round trip is long and adds to it
            return table is not None and all(0 <= n.cost - PERFECT <= RTT_PENALTY for n in table.neighbours)

        await pair["uav1"].until(perfect, pair["uav1"].neighbours)
        pair["uav2"].app.inbox("cmd/note", Text)
        large = Text("x" * FRAME_MAX)  # a smaller one needs no connection
        await pair["uav1"].app.send(join("uav2", "cmd/note"), large, timeout_s=PATIENCE_S)

        def connected() -> bool:
            table = pair["uav1"].neighbours.value
            return table is not None and [n.transport for n in table.neighbours] == ["tcp"]

        await pair["uav1"].until(connected, pair["uav1"].neighbours)


@on_uvloop
async def test_board_too_large_for_beacon_is_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with swarm(tmp_path, "uav1") as one:
        text = one["uav1"].app.writer("plan/text", Text)
        one["uav1"].plan(offers=[("plan/text", Text)])
        text.write(Text("x" * 5000))
        traffic = await one["uav1"].until_counted(
            lambda traffic: any(c.channel == "plan/text" and c.dropped == 1 for c in traffic.channels)
        )
        assert [c.sent_frames for c in traffic.channels if c.channel == "plan/text"] == [0]
    assert "board plan/text: 5004 bytes do not fit into a beacon" in caplog.text


@on_uvloop
async def test_mirror_without_readers_is_removed(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        level = pair["uav1"].app.writer("power/level", Float)
        level.write(Float(1.0))
        pair["uav1"].plan(offers=[("power/level", Float)])
        pair["uav2"].plan(wants=[("uav1", "power/level", Float)])
        reader = pair["uav2"].app.reader("/uav1/power/level", Float)
        await reader.changed(PATIENCE_S)
        assert reader.alive
        pair["uav2"].plan(wants=[])
        before = pair["uav2"].counters.sequence
        await pair["uav2"].until(lambda: pair["uav2"].counters.sequence > before + 1, pair["uav2"].counters)
        assert not reader.alive
