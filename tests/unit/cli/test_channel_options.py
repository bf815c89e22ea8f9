"""Options of `traffic set`, and what the commands of channels print."""

from typing import Any

import pytest
from tests.unit.cli.session import ScriptedSession

from swarmctl.commands.traffic.channels import (
    change,
    clear_channels,
    duration_s,
    list_channels,
    set_channel,
    undo_channel,
)
from swarmware.errors import InvalidInput, OutOfRange
from swarmware.types import registry
from swarmware.types.channel import (
    NO_SETTINGS,
    RATE_MAX_HZ,
    ChannelLimit,
    ChannelLimits,
    ChannelPriority,
    ChannelProtocol,
    ChannelRate,
    ChannelRefusal,
    ChannelSettings,
    ChannelState,
    ChannelStates,
    CompressionState,
    RateSource,
    SetChannel,
)
from swarmware.types.tree import TreeValue

WHOLE = ChannelSettings(5.0, ChannelProtocol.ZMQ, "zstd:1", 2_000_000, 30.0, ChannelPriority.LOW)
LIMITS = ChannelLimits(
    (
        ChannelLimit("sensor/**", WHOLE, 12.5, "gcs"),
        ChannelLimit("**", ChannelSettings(RATE_MAX_HZ), from_file=True),
    )
)

POSE_RATE = ChannelRate(RateSource.RESOURCE, 10.0, "uav1")
LIDAR_RATE = ChannelRate(RateSource.OPERATOR, 5.0, "uav1", "sensor/**", "gcs")


def options(**given: str) -> tuple[ChannelSettings, tuple[str, ...]]:
    names = ("rate", "protocol", "compress", "buffer", "priority")
    return change(*(given.get(name) for name in names))


def test_all_options_together_are_settings() -> None:
    found, unset = options(rate="5hz", protocol="zmq", compress="zstd:1", buffer="2MB/30s", priority="low")
    assert found == WHOLE
    assert unset == ()
    assert str(found) == "--rate 5hz --protocol zmq --compress zstd:1 --priority low --buffer 2MB/30s"


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"rate": "0hz"}, ChannelSettings(0.0)),
        ({"rate": "max"}, ChannelSettings(RATE_MAX_HZ)),
        ({"rate": "auto"}, ChannelSettings(RATE_MAX_HZ, adaptive=True)),
        ({"rate": "auto:30hz"}, ChannelSettings(30.0, adaptive=True)),
        ({"compress": "zlib"}, ChannelSettings(compression="zlib:6")),
        ({"compress": "none"}, ChannelSettings(compression="none")),
        ({"buffer": "64kB"}, ChannelSettings(buffer_bytes=64_000)),
        ({"buffer": "1MiB"}, ChannelSettings(buffer_bytes=1_048_576)),
        ({"buffer": "5m"}, ChannelSettings(buffer_s=300.0)),
        ({"buffer": "30s/500B"}, ChannelSettings(buffer_bytes=500, buffer_s=30.0)),
    ],
)
def test_an_option_is_a_setting(given: dict[str, str], expected: ChannelSettings) -> None:
    assert options(**given) == (expected, ())


@pytest.mark.parametrize("rate", ["5hz", "max", "auto", "auto:30hz"])
def test_a_rate_is_shown_as_it_is_set(rate: str) -> None:
    assert str(options(rate=rate)[0]) == f"--rate {rate}"


def test_default_and_auto_take_setting_out_of_rule() -> None:
    found, unset = options(rate="default", protocol="auto", buffer="auto", priority="auto")
    assert found == ChannelSettings()
    assert unset == ("max_hz", "protocol", "priority", "buffer_bytes", "buffer_s")


@pytest.mark.parametrize(
    ("given", "error", "reason"),
    [
        ({"rate": "fast"}, InvalidInput, "expected 5hz"),
        ({"rate": "auto:"}, InvalidInput, "expected 5hz"),
        ({"rate": "auto:slow"}, InvalidInput, "expected 5hz"),
        ({"rate": "2000000hz"}, OutOfRange, "max_hz"),
        ({"compress": "h264", "protocol": "udp"}, InvalidInput, "rtp with h264"),
        ({"compress": "jpeg", "protocol": "rtp"}, InvalidInput, "rtp with h264"),
        ({"buffer": "2MB/"}, InvalidInput, "time ''"),
        ({"buffer": "2MB/3MB"}, InvalidInput, "expected a size, a time or both"),
        ({"buffer": "2s/3s"}, InvalidInput, "expected a size, a time or both"),
        ({"buffer": "2GB"}, InvalidInput, "size '2GB'"),
        ({"buffer": "900MB"}, OutOfRange, "buffer_bytes"),
        ({"buffer": "2d"}, OutOfRange, "buffer_s"),
    ],
)
def test_invalid_option_is_refused_before_node_is_joined(
    given: dict[str, str], error: type[Exception], reason: str
) -> None:
    with pytest.raises(error, match=reason):
        options(**given)


def test_zero_time_is_not_taken_as_unlimited() -> None:
    assert (duration_s(""), duration_s("5m")) == (0.0, 300.0)
    for text in ("0s", "2d"):
        with pytest.raises(OutOfRange, match=f"--for {text}: expected more than 0s, at most 24h"):
            duration_s(text)


def session(**answers: Any) -> ScriptedSession:
    found = {f"/uav1/sys/broker/{verb}": answer for verb, answer in answers.items()}
    return ScriptedSession(found, node="uav1")


async def test_rules_are_printed_with_inapplicable_resources_and_reason() -> None:
    refused = tuple(ChannelRefusal(f"nav/{name}", "only its newest value waits") for name in "abcde")
    one = session(set_channel=ChannelLimits(LIMITS.limits, refused))
    await set_channel(one, SetChannel("sensor/**", WHOLE, link="gcs"), yes=False)
    text = one.stdout.getvalue()
    for word in ("sensor/**", "gcs", "5 Hz", "zmq", "zstd:1", "2MB/30s", "low", "12s", "operator"):
        assert word in text
    assert "max" in text
    assert "file" in text
    assert "not for nav/a, nav/b, nav/c and 2 more: only its newest value waits" in one.stderr.getvalue()


async def test_undo_and_clear_print_rules_that_are_left() -> None:
    for act in (undo_channel, lambda one: clear_channels(one, "nav/*")):
        one = session(undo_channel=ChannelLimits(), clear_channels=ChannelLimits())
        await act(one)
        assert "uav1: no rule is set for channels" in one.stdout.getvalue() + one.stderr.getvalue()


def channels_session(**options: str) -> ScriptedSession:
    """A session with a node that has two channels, of which one is compressed."""
    states = ChannelStates(
        (
            ChannelState("nav/pose", "*", NO_SETTINGS, 0, 0, 0, 0, rate=POSE_RATE),
            ChannelState("sensor/lidar", "gcs", WHOLE, 7, 8442, 3, 1234, 62.46, "queue of 84 ms", LIDAR_RATE),
        ),
        (
            CompressionState("sensor/lidar", 100_000, 28_000, 0.25),
            CompressionState("camera", 0, 0, 0.0, "expected an Image"),
        ),
    )
    board = TreeValue(
        "/uav1/net/limits",
        "ChannelLimits",
        registry.encode(LIMITS),
        1,
        1,
        1,
        4.5,
        "live",  # type: ignore[arg-type]
    )
    answers = {
        "/uav1/sys/tree/get /uav1/net/limits": board,
        "sys/tree/channels": states,
        "/uav1/sys/tree/channels": states,
    }
    return ScriptedSession(answers, node="uav1", **options)


async def test_channel_state_shows_waiting_dropped_and_saved() -> None:
    one = channels_session()
    await list_channels(one)
    text = one.stdout.getvalue()
    for word in ("sensor/lidar", "gcs", "8442", "1234", "62.5 Hz", "queue of 84 ms", "72.0", "0.25"):
        assert word in text
    assert " 8.0s " in text, "12.5 s were left when the rules were published, 4.5 s ago"
    assert "camera: sent without its compression: expected an Image" in one.stderr.getvalue()
    structured = channels_session(output="json")
    await list_channels(structured)
    [lidar] = structured.document["states"]["channels"][1:]
    assert lidar["dropped"] == 3
    assert lidar["rate"] == {
        "source": "traffic set",
        "max_hz": 5.0,
        "platform": "uav1",
        "pattern": "sensor/**",
        "link": "gcs",
    }


async def test_channels_show_rate_and_where_set() -> None:
    one = channels_session()
    await list_channels(one)
    lines = [line.split() for line in one.stdout.getvalue().splitlines()]
    assert ["nav/pose", "*", "10", "Hz", "rate_hz", "uav1"] in [words[:6] for words in lines]
    [lidar] = [words for words in lines if words[:1] == ["sensor/lidar"] and "gcs" in words]
    assert lidar[2:4] == ["62.5", "Hz"], "the link is slower than what was set"
    assert " ".join(lidar[4:10]) == "traffic set uav1 sensor/** --link gcs"


async def test_channels_of_pattern_leave_out_others() -> None:
    one = channels_session(output="json")
    await list_channels(one, "nav/*")
    assert [state["path"] for state in one.document["states"]["channels"]] == ["nav/pose"]
