"""Needs of resources against the capacity of a link: rates, limits, compression, fair shares."""

import msgspec
import pytest
from tests.unit.cli.session import ScriptedSession

from swarmctl.commands.traffic.needs import ChannelNeed, compare, show_needs
from swarmware.errors import NotFound
from swarmware.model.resource import Kind
from swarmware.types import registry
from swarmware.types.channel import (
    ChannelLimit,
    ChannelLimits,
    ChannelSettings,
    ChannelStates,
    CompressionState,
)
from swarmware.types.net import LinkTransport
from swarmware.types.traffic import ChannelTraffic, LinkTraffic, Traffic
from swarmware.types.tree import TreeEntry, TreeListing, TreeValue

LIDAR, CAMERA, POSE = "sensor/lidar", "sensor/camera", "nav/pose"
SIZES = {LIDAR: 1200.0, CAMERA: 50_000.0, POSE: 25.0}


def entry(path: str, hz: float | None, kind: Kind = Kind.STREAM) -> TreeEntry:
    return TreeEntry(f"/uav1/{path}", kind, "Blob", measured_hz=hz)


ENTRIES = [entry(LIDAR, 750.0), entry(CAMERA, 10.0), entry(POSE, 10.0, Kind.BOARD)]


def needs(
    capacity: float, *limits: ChannelLimit, link: str = "", ratios: dict[str, float] | None = None
) -> dict[str, ChannelNeed]:
    found = compare(ENTRIES, SIZES, limits, ratios or {}, link, capacity)
    return {need.path: need for need in found}


def test_need_is_rate_times_size_largest_first() -> None:
    found = needs(1e9)
    assert list(found) == [LIDAR, CAMERA, POSE]
    assert [need.sent_bytes_s for need in found.values()] == [900_000, 500_000, 250]
    assert {need.fair_hz for need in found.values()} == {None}


def test_limits_and_compression_reduce_sent_not_written() -> None:
    limit = ChannelLimit("sensor/camera", ChannelSettings(2.0), link="gcs")
    coded = ChannelLimit(LIDAR, ChannelSettings(compression="auto"))
    found = needs(1e9, limit, coded, link="gcs", ratios={LIDAR: 0.28})
    assert found[LIDAR].sent_bytes_s == pytest.approx(252_000)
    assert needs(1e9, ratios={LIDAR: 0.28})[LIDAR].sent_bytes_s == 900_000, "it is not compressed any longer"
    assert found[CAMERA].sent_bytes_s == 100_000
    assert found[CAMERA].written_bytes_s == 500_000
    assert needs(1e9, limit)[CAMERA].sent_bytes_s == 500_000, "not on the way to others"


def test_large_channels_share_rest_of_small_link() -> None:
    found = needs(100_250)
    assert found[POSE].fair_hz is None
    assert found[LIDAR].fair_hz == pytest.approx(750 * 50_000 / 900_000)
    assert found[CAMERA].fair_hz == pytest.approx(1.0)
    share = sum(
        need.sent_bytes_s * (1 if need.fair_hz is None else need.fair_hz / need.written_hz)
        for need in found.values()
    )
    assert share == pytest.approx(100_250)


def test_fair_rate_is_below_limit_in_force() -> None:
    limit = ChannelLimit("sensor/camera", ChannelSettings(4.0))
    assert needs(100_250, limit)[CAMERA].fair_hz == pytest.approx(1.0)


def session(output: str = "table", *entries: TreeEntry) -> ScriptedSession:
    counters = ChannelTraffic(LIDAR, offered_frames=10, offered_bytes=3_000)
    slow = LinkTraffic("gcs", LinkTransport.UDP, capacity_bytes_s=60_000.0, capacity_ns=-3_000_000_000)
    links = [LinkTraffic("gcs", LinkTransport.TCP), slow]
    traffic = msgspec.convert(
        [0] * 16 + [1.0, [], msgspec.to_builtins(links), [msgspec.to_builtins(counters)]], Traffic
    )
    rule = ChannelLimit("sensor/*", ChannelSettings(100.0, compression="zstd:1"))
    limits = registry.encode(ChannelLimits((rule,)))

    def value(path: str, data: bytes) -> TreeValue:
        return TreeValue(f"/uav1/{path}", "Blob", data, 1, 1, 1, 0.1, "live")  # type: ignore[arg-type]

    states = ChannelStates((), (CompressionState(LIDAR, 1000, 250, 0.1),))
    answers = {
        "/uav1/sys/tree/list": TreeListing(entries or tuple(ENTRIES)),
        "sys/broker/traffic": traffic,
        "/uav1/sys/broker/traffic": traffic,
        "sys/tree/channels": states,
        "/uav1/sys/tree/channels": states,
        "/uav1/sys/tree/get /uav1/net/limits": value("net/limits", limits),
        f"/uav1/sys/tree/get /uav1/{CAMERA}": value(CAMERA, bytes(50_000)),
        f"/uav1/sys/tree/get /uav1/{POSE}": value(POSE, bytes(25)),
        f"/uav1/sys/tree/get /uav1/{LIDAR}": value(LIDAR, bytes(1200)),
    }
    return ScriptedSession(answers, node="uav1", output=output)


async def test_needs_are_printed_with_fitting_command() -> None:
    one = session()
    await show_needs(one, "**", "gcs", 125_000.0)
    text = one.stdout.getvalue()
    for word in ("sensor/camera", "sensor/lidar", "nav/pose", "does not fit"):
        assert word in text
    said = one.stdout.getvalue() + one.stderr.getvalue()
    assert "swarmctl traffic set /uav1/sensor/camera --link gcs --rate 1.9hz" in said
    structured = session("json")
    await show_needs(structured, "**", "", 1e6)
    assert structured.document["fits"] is True
    by_path = {one["path"]: one["sent_bytes_s"] for one in structured.document["channels"]}
    assert by_path[LIDAR] == pytest.approx(100 * 1200 * 0.25)


async def test_measured_capacity_is_shown_beside_stated_one() -> None:
    both = session()
    await show_needs(both, "**", "gcs", 1e6)
    assert "a link of 1000.0 kB/s: fits; measured 3 s ago: 60.0 kB/s, does not fit" in both.stdout.getvalue()
    alone = session()
    await show_needs(alone, "**", "gcs", None)
    assert "a link of 60.0 kB/s: does not fit (measured 3 s ago)" in alone.stdout.getvalue()
    measured = session("json")
    await show_needs(measured, "**", "gcs", None)
    assert measured.document["capacity_bytes_s"] == measured.document["measured_bytes_s"] == 60_000.0
    assert measured.document["fits"] is False
    with pytest.raises(NotFound, match=r"link uav1 to uav2: .*not measured.*expected --capacity"):
        await show_needs(session(), "**", "uav2", None)


async def test_pattern_of_nothing_that_is_written_is_named() -> None:
    with pytest.raises(NotFound, match=r"/uav1/\*\*: matches no resource"):
        await show_needs(session("table", entry("plan/path", None)), "**", "", 1e6)
