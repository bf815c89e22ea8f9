"""Rules of channels: which applies, how long, what takes them back, and what cannot be set."""

from pathlib import Path

import msgspec
import pytest

from swarmd.broker.boards.channel_store import ChannelStore
from swarmd.broker.core.boards.channel_table import (
    NO_RESOURCE,
    RULES_LIMIT,
    UNDO_LIMIT,
    ChannelTable,
    KeptChannels,
    KeptRule,
    refusals,
)
from swarmware.errors import InvalidInput, NotFound, OutOfRange, SwarmError
from swarmware.model.clock import Clock
from swarmware.model.resource import Kind, Resource
from swarmware.types.channel import (
    RATE_MAX_HZ,
    ChannelLimit,
    ChannelPriority,
    ChannelProtocol,
    ChannelRefusal,
    ChannelSettings,
    SetChannel,
    settings_of,
)

S = 1_000_000_000
FILE = (
    ChannelLimit("sensor/**", ChannelSettings(10.0, compression="zlib:6"), link="gcs", from_file=True),
    ChannelLimit("**", ChannelSettings(priority=ChannelPriority.LOW), from_file=True),
)
POSE = Resource(path="nav/pose", type="Pose", rate_hz=20.0)
BATTERY = Resource(path="power/battery", type="Battery")
GAIN = Resource(path="config/hal/gain", kind=Kind.SETTING, type="Float", default=1.0)
PICTURE = Resource(path="sensor/camera/image", kind=Kind.STREAM, type="Image")
CLOUD = Resource(path="sensor/lidar/packets", kind=Kind.STREAM, type="Blob")
FAULTS = Resource(path="health/faults", kind=Kind.EVENT, type="Fault")
GOTO = Resource(path="cmd/goto", kind=Kind.COMMAND, type="Goto")
MAP = Resource(path="map/tiles", kind=Kind.FILE, type="Blob")


@pytest.fixture
def table() -> ChannelTable:
    return ChannelTable(FILE)


def settings(table: ChannelTable, path: str, link: str = "", now_ns: int = 0) -> ChannelSettings:
    return settings_of(table.limits(now_ns).limits, path, link)


def test_each_setting_comes_from_first_matching_rule(table: ChannelTable) -> None:
    assert settings(table, "sensor/lidar", "gcs") == ChannelSettings(
        10.0, compression="zlib:6", priority=ChannelPriority.LOW
    )
    assert settings(table, "sensor/lidar", "uav2") == ChannelSettings(priority=ChannelPriority.LOW)
    table.set(SetChannel("sensor/*", ChannelSettings(2.0)), 0)
    table.set(SetChannel("**", ChannelSettings(priority=ChannelPriority.HIGH), link="g*"), 0)
    assert settings(table, "sensor/lidar", "gcs") == ChannelSettings(
        2.0, compression="zlib:6", priority=ChannelPriority.HIGH
    )


def test_link_rule_does_not_hold_for_broadcasts(table: ChannelTable) -> None:
    assert settings(table, "sensor/lidar").max_hz is None
    assert table.max_hz("sensor/lidar") is None
    table.set(SetChannel("sensor/lidar", ChannelSettings(1.0)), 0)
    assert table.max_hz("sensor/lidar") == 1.0


def test_change_keeps_other_settings_of_rule(table: ChannelTable) -> None:
    table.set(SetChannel("nav/*", ChannelSettings(5.0)), 0)
    table.set(SetChannel("nav/*", ChannelSettings(compression="zstd:1")), 0)
    assert settings(table, "nav/pose").max_hz == 5.0
    assert settings(table, "nav/pose").compression == "zstd:1"
    table.set(SetChannel("nav/*", unset=("max_hz",)), 0)
    assert settings(table, "nav/pose").max_hz is None
    table.set(SetChannel("nav/*", unset=("compression",)), 0)
    assert table.limits(0).limits == FILE, "a rule that sets nothing is none"


@pytest.mark.parametrize(
    ("before", "change", "unset", "expected"),
    [
        (("rtp", "h264"), (None, "jpeg:70"), (), (None, "jpeg:70")),
        (("rtp", None), (None, "none"), (), (None, "none")),
        (("rtp", "h264"), ("zmq", None), (), ("zmq", None)),
        (("rtp", "h264"), (None, None), ("protocol",), (None, None)),
        (("zmq", "zlib:6"), (None, "h264"), (), (None, "h264")),
        ((None, "zlib:6"), ("rtp", None), (), ("rtp", None)),
        (("rtp", None), (None, "h264"), (), ("rtp", "h264")),
        (("zmq", "zlib:6"), (None, "zstd:1"), (), ("zmq", "zstd:1")),
    ],
)
def test_images_leave_video_when_protocol_or_compression_changes(
    table: ChannelTable,
    before: tuple[str | None, str | None],
    change: tuple[str | None, str | None],
    unset: tuple[str, ...],
    expected: tuple[str | None, str | None],
) -> None:
    for (protocol, compression), taken in ((before, ()), (change, unset)):
        wanted = ChannelSettings(4.0, ChannelProtocol(protocol) if protocol else None, compression)
        table.set(SetChannel(PICTURE.path, wanted, link="gcs", unset=taken), 0)
    found = table.limits(0).limits[0].settings
    assert (found.protocol, found.compression) == expected
    assert found.max_hz == 4.0
    found.check()


def test_request_without_settings_removes_its_rule(table: ChannelTable) -> None:
    table.set(SetChannel("nav/*", ChannelSettings(5.0)), 0)
    table.set(SetChannel("nav/*", ChannelSettings(1.0), link="gcs"), 0)
    table.set(SetChannel("nav/*"), 0)
    assert settings(table, "nav/pose", "uav2").max_hz is None
    assert settings(table, "nav/pose", "gcs").max_hz == 1.0


def test_rate_max_lifts_limit_of_file(table: ChannelTable) -> None:
    table.set(SetChannel("sensor/**", ChannelSettings(RATE_MAX_HZ)), 0)
    assert settings(table, "sensor/lidar", "gcs").max_hz == RATE_MAX_HZ


def test_set_rate_replaces_rate_of_link(table: ChannelTable) -> None:
    auto = ChannelSettings(RATE_MAX_HZ, adaptive=True)
    table.set(SetChannel("sensor/**", auto), 0)
    assert settings(table, "sensor/lidar").adaptive
    table.set(SetChannel("sensor/lidar", ChannelSettings(5.0)), 0)

    def rate(path: str) -> str:
        return settings(table, path).rate

    assert rate("sensor/lidar") == "5hz"
    assert rate("sensor/sonar") == "auto", "for what the later rule does not match"
    table.set(SetChannel("sensor/**", ChannelSettings(7.0)), 0)
    assert rate("sensor/sonar") == "7hz", "nor in the same rule"
    table.set(SetChannel("sensor/**", auto), 0)
    table.set(SetChannel("sensor/**", ChannelSettings(compression="zlib:1")), 0)
    assert rate("sensor/sonar") == "auto", "another setting leaves it"
    table.set(SetChannel("sensor/**", unset=("max_hz",)), 0)
    assert rate("sensor/sonar") == ""
    assert settings(table, "sensor/sonar").compression == "zlib:1"


def test_rate_following_link_may_have_limit() -> None:
    with pytest.raises(InvalidInput, match="adaptive without max_hz"):
        ChannelSettings(adaptive=True).check()


def test_after_its_time_the_former_settings_apply_again(table: ChannelTable) -> None:
    table.set(SetChannel("nav/*", ChannelSettings(5.0)), 0)
    table.set(SetChannel("nav/*", ChannelSettings(1.0), for_s=10.0), S)
    table.set(SetChannel("nav/*", ChannelSettings(2.0), for_s=20.0), 2 * S)
    [rule, *_] = table.limits(7 * S).limits
    assert rule.remaining_s == 15.0
    before = table.version
    table.advance(21 * S)
    assert table.version == before
    table.advance(22 * S)
    assert table.version == before + 1
    assert settings(table, "nav/pose").max_hz == 5.0
    table.set(SetChannel("power/*", ChannelSettings(1.0), for_s=1.0), 22 * S)
    table.advance(23 * S)
    assert settings(table, "power/battery").max_hz is None


def test_changes_are_taken_back_one_after_the_other(table: ChannelTable) -> None:
    table.set(SetChannel("nav/*", ChannelSettings(5.0)), 0)
    table.set(SetChannel("nav/*", ChannelSettings(1.0)), 0)
    table.clear("")
    assert table.limits(0).limits == FILE
    table.undo(0)
    assert settings(table, "nav/pose").max_hz == 1.0
    table.undo(0)
    assert settings(table, "nav/pose").max_hz == 5.0
    table.undo(0)
    assert table.limits(0).limits == FILE
    with pytest.raises(NotFound, match="no change"):
        table.undo(0)


def test_expired_change_does_not_return(table: ChannelTable) -> None:
    table.set(SetChannel("nav/*", ChannelSettings(1.0), for_s=1.0), 0)
    table.set(SetChannel("power/*", ChannelSettings(1.0)), 0)
    table.undo(2 * S)
    assert table.limits(2 * S).limits == FILE


def test_only_changes_in_force_are_undone(table: ChannelTable) -> None:
    table.set(SetChannel("nav/*", ChannelSettings(5.0)), 0)
    table.set(SetChannel("nav/*", ChannelSettings(1.0), for_s=1.0), 0)
    table.undo(2 * S)
    assert table.limits(2 * S).limits == FILE, "the second change has ended, so the first one is taken back"
    table.set(SetChannel("power/*", ChannelSettings(1.0), for_s=1.0), 2 * S)
    with pytest.raises(NotFound, match="no change"):
        table.undo(4 * S)


def test_only_the_last_changes_can_be_taken_back(table: ChannelTable) -> None:
    for number in range(UNDO_LIMIT + 5):
        table.set(SetChannel("nav/*", ChannelSettings(float(number))), 0)
    for _ in range(UNDO_LIMIT):
        table.undo(0)
    assert settings(table, "nav/pose").max_hz == 4.0
    with pytest.raises(NotFound):
        table.undo(0)


def test_rules_are_removed_by_pattern_or_named(table: ChannelTable) -> None:
    table.set(SetChannel("nav/*", ChannelSettings(5.0)), 0)
    table.set(SetChannel("nav/*", ChannelSettings(5.0), link="gcs"), 0)
    table.set(SetChannel("power/*", ChannelSettings(5.0)), 0)
    table.clear("nav/*")
    assert [rule.pattern for rule in table.limits(0).limits[:1]] == ["power/*"]
    for pattern in ("nav/*", "sensor/**"):
        with pytest.raises(NotFound, match="no operator"):
            table.clear(pattern)


@pytest.mark.parametrize(
    ("request_", "error", "reason"),
    [
        (SetChannel("**", ChannelSettings(-1.0)), OutOfRange, "max_hz -1.0: expected 0"),
        (SetChannel("**", ChannelSettings(float("nan"))), OutOfRange, "max_hz nan"),
        (SetChannel("**", ChannelSettings(1.0), for_s=1e9), OutOfRange, "for_s"),
        (SetChannel("Not a path", ChannelSettings(1.0)), InvalidInput, "Not a path"),
        (SetChannel("**", ChannelSettings(1.0), link="Not a name"), InvalidInput, "Not a name"),
        (SetChannel("**", ChannelSettings(compression="lzma")), InvalidInput, "lzma"),
        (
            SetChannel("**", ChannelSettings(protocol=ChannelProtocol.ZMQ, compression="h264"), link="gcs"),
            InvalidInput,
            "expected rtp with h264",
        ),
        (
            SetChannel("**", ChannelSettings(protocol=ChannelProtocol.RTP, compression="zlib"), link="gcs"),
            InvalidInput,
            "expected rtp with h264",
        ),
        (SetChannel("**", ChannelSettings(protocol=ChannelProtocol("sctp"))), InvalidInput, "sctp"),
        (SetChannel("**", ChannelSettings(priority=ChannelPriority("top"))), InvalidInput, "top"),
        (SetChannel("**", ChannelSettings(buffer_bytes=0)), OutOfRange, "buffer_bytes 0"),
        (SetChannel("**", ChannelSettings(buffer_s=float("inf"))), OutOfRange, "buffer_s inf"),
        (SetChannel("**", unset=("color",)), InvalidInput, "color"),
    ],
)
def test_senseless_setting_is_refused_and_changes_nothing(
    table: ChannelTable, request_: SetChannel, error: type[Exception], reason: str
) -> None:
    with pytest.raises(error, match=reason):
        table.set(request_, 0)
    assert table.limits(0).limits == FILE
    assert table.version == 0


def test_the_number_of_rules_is_bounded(table: ChannelTable) -> None:
    for number in range(RULES_LIMIT):
        table.set(SetChannel(f"nav/n{number}", ChannelSettings(1.0)), 0)
    with pytest.raises(OutOfRange, match="traffic clear"):
        table.set(SetChannel("nav/other", ChannelSettings(1.0)), 0)
    table.set(SetChannel("nav/n7", ChannelSettings(2.0)), 0)


@pytest.mark.parametrize(
    ("resource", "change", "link", "reason"),
    [
        (GOTO, ChannelSettings(1.0), "", "each message is delivered"),
        (MAP, ChannelSettings(1.0), "", "files take what all other channels leave"),
        (POSE, ChannelSettings(1.0), "gcs", "beacons go to all neighbours"),
        (POSE, ChannelSettings(compression="zlib:6"), "", "packed already"),
        (POSE, ChannelSettings(priority=ChannelPriority.HIGH), "", "waited longest"),
        (BATTERY, ChannelSettings(1.0, ChannelProtocol.UDP), "gcs", "beacons go to all neighbours"),
        (BATTERY, ChannelSettings(protocol=ChannelProtocol.ZMQ), "gcs", "holds for all links"),
        (POSE, ChannelSettings(buffer_bytes=5), "", "with --protocol zmq a buffer keeps former ones"),
        (POSE, ChannelSettings(buffer_s=5.0), "", "a beacon has only its newest value"),
        (GAIN, ChannelSettings(buffer_s=5.0), "", "only its newest value waits"),
        (CLOUD, ChannelSettings(protocol=ChannelProtocol.UDP), "", "items of kind stream are acknowledged"),
        (FAULTS, ChannelSettings(protocol=ChannelProtocol.ZMQ), "", "items of kind event are acknowledged"),
        (CLOUD, ChannelSettings(compression="jpeg:80"), "", "JPEG is for values of type Image, not Blob"),
        (POSE, ChannelSettings(RATE_MAX_HZ, adaptive=True), "", "with --protocol zmq it follows the link"),
        (FAULTS, ChannelSettings(RATE_MAX_HZ, adaptive=True), "gcs", "no event is left out"),
        (GOTO, ChannelSettings(RATE_MAX_HZ, adaptive=True), "", "each message is delivered"),
    ],
)
def test_impossible_setting_of_resource_is_refused_with_reason(
    resource: Resource, change: ChannelSettings, link: str, reason: str
) -> None:
    with pytest.raises(InvalidInput, match=f"{resource.path} \\(.*{reason}"):
        refusals(SetChannel(resource.path, change, link=link), [resource])


@pytest.mark.parametrize(
    ("resource", "change", "link"),
    [
        (POSE, ChannelSettings(1.0), ""),
        (POSE, ChannelSettings(1.0, ChannelProtocol.ZMQ, "zlib:6"), ""),
        (BATTERY, ChannelSettings(1.0, compression="auto", priority=ChannelPriority.HIGH), "gcs"),
        (BATTERY, ChannelSettings(protocol=ChannelProtocol.UDP), ""),
        (BATTERY, ChannelSettings(buffer_bytes=2_000_000, buffer_s=30.0), "gcs"),
        (POSE, ChannelSettings(protocol=ChannelProtocol.ZMQ, buffer_s=30.0), ""),
        (CLOUD, ChannelSettings(5.0, None, "zstd:1", 2_000_000, 30.0, ChannelPriority.LOW), "gcs"),
        (FAULTS, ChannelSettings(5.0, None, "zlib:1", 10_000, 3.0), ""),
        (PICTURE, ChannelSettings(compression="jpeg:80"), "gcs"),
        (GOTO, ChannelSettings(), ""),
        (CLOUD, ChannelSettings(RATE_MAX_HZ, adaptive=True), "gcs"),
        (BATTERY, ChannelSettings(30.0, adaptive=True), "gcs"),
        (POSE, ChannelSettings(RATE_MAX_HZ, ChannelProtocol.ZMQ, adaptive=True), ""),
    ],
)
def test_what_can_hold_is_accepted(resource: Resource, change: ChannelSettings, link: str) -> None:
    assert refusals(SetChannel(resource.path, change, link=link), [resource]) == ()


def test_board_outside_beacons_has_links() -> None:
    present = [ChannelLimit("nav/*", ChannelSettings(protocol=ChannelProtocol.ZMQ))]
    assert refusals(SetChannel("nav/pose", ChannelSettings(1.0), link="gcs"), [POSE], present) == ()


def test_pattern_is_judged_by_its_fitting_resources() -> None:
    resources = [GOTO, POSE, CLOUD, FAULTS, BATTERY, MAP, GAIN]
    [pose, gain] = refusals(SetChannel("**", ChannelSettings(1.0, buffer_s=3.0)), resources)
    assert (pose.path, gain.path) == ("nav/pose", "config/hal/gain")
    assert gain.reason == "only its newest value waits"


def test_rule_without_matching_resource_is_accepted_with_note() -> None:
    assert refusals(SetChannel("future/**", ChannelSettings(1.0)), [POSE]) == (
        ChannelRefusal("future/**", NO_RESOURCE),
    )
    assert refusals(SetChannel("future/**", unset=("max_hz",)), [POSE]) == (), "it takes a rule back"
    assert refusals(SetChannel("lens", RTP, link="gcs"), [VIDEO]) == (), "a source of video"


def test_board_is_resource_where_inbox_has_its_path() -> None:
    inbox = Resource(path="nav/pose", kind=Kind.COMMAND, type="Pose")
    for order in ([inbox, POSE], [POSE, inbox]):
        assert refusals(SetChannel("nav/pose", ChannelSettings(1.0)), order) == ()


VIDEO = Resource(path="sys/video/start", kind=Kind.COMMAND, type="VideoStart")
RTP = ChannelSettings(protocol=ChannelProtocol.RTP)
H264 = ChannelSettings(5.0, compression="h264")


@pytest.mark.parametrize("settings_", [RTP, H264, ChannelSettings(None, ChannelProtocol.RTP, "h264")])
def test_images_go_as_video_on_named_link(settings_: ChannelSettings) -> None:
    assert refusals(SetChannel("sensor/**", settings_, link="gcs"), [PICTURE, VIDEO]) == ()
    with pytest.raises(InvalidInput, match="expected --link"):
        refusals(SetChannel("sensor/**", settings_), [PICTURE, VIDEO])
    with pytest.raises(InvalidInput, match="the service `video` does not run here"):
        refusals(SetChannel("sensor/**", settings_, link="gcs"), [PICTURE])


def test_non_image_stream_is_never_video() -> None:
    (refused,) = refusals(SetChannel("sensor/**", RTP, link="gcs"), [PICTURE, CLOUD, VIDEO])
    assert (refused.path, "streams of type Image" in refused.reason) == (CLOUD.path, True)
    buffered = ChannelSettings(None, ChannelProtocol.RTP, buffer_s=3.0)
    (refused,) = refusals(SetChannel("sensor/camera/*", buffered, link="gcs"), [PICTURE, VIDEO])
    assert refused.reason == "what is late of a video is left out"


def kept(table: ChannelTable) -> KeptChannels:
    """What outlives a broker, by way of its file."""
    return msgspec.json.decode(msgspec.json.encode(table.kept(7)), type=KeptChannels)


def test_rules_and_undo_records_outlive_broker(table: ChannelTable) -> None:
    table.set(SetChannel("nav/*", ChannelSettings(5.0, ChannelProtocol.ZMQ, "zlib:6", 9, 2.0)), 0)
    table.set(SetChannel("nav/*", ChannelSettings(1.0), for_s=60), 0)
    table.set(SetChannel("sensor/*", ChannelSettings(2.0), link="gcs"), 0)
    later = ChannelTable(FILE)
    later.restore(kept(table), 7, 10 * S)
    assert later.limits(10 * S) == table.limits(10 * S)
    later.undo(10 * S)
    later.undo(10 * S)
    assert settings(later, "nav/pose").max_hz == 5.0
    later.undo(10 * S)
    with pytest.raises(NotFound):
        later.undo(10 * S)


def test_rule_expires_between_brokers_and_after_boot(
    table: ChannelTable,
) -> None:
    table.set(SetChannel("nav/*", ChannelSettings(5.0)), 0)
    table.set(SetChannel("nav/*", ChannelSettings(1.0), for_s=60), 0)
    table.set(SetChannel("sensor/*", ChannelSettings(1.0), for_s=60), 0)
    for boot_id, now_ns in ((7, 61 * S), (8, 10 * S)):
        later = ChannelTable(FILE)
        later.restore(kept(table), boot_id, now_ns)
        assert settings(later, "nav/pose").max_hz == 5.0
        assert settings(later, "sensor/lidar").max_hz is None


@pytest.mark.parametrize(
    ("link", "settings_"), [("Not a name", ChannelSettings(1.0)), ("gcs", ChannelSettings(-1.0))]
)
def test_kept_rules_that_are_invalid_change_nothing(
    table: ChannelTable, link: str, settings_: ChannelSettings
) -> None:
    table.set(SetChannel("nav/*", ChannelSettings(5.0)), 0)
    bad = KeptChannels(7, (("nav/*", link, KeptRule(settings_)),), ())
    with pytest.raises(SwarmError):
        table.restore(bad, 7, 0)
    assert settings(table, "nav/pose").max_hz == 5.0


def test_file_keeps_rules_and_damaged_is_set_aside(
    table: ChannelTable, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    clock = Clock(boot_id=7)
    store = ChannelStore(table, tmp_path, clock)
    table.set(SetChannel("nav/*", ChannelSettings(5.0)), S)
    store.keep()
    again = ChannelTable()
    ChannelStore(again, tmp_path, clock)
    assert [str(rule) for rule in again.limits(S).limits] == ["nav/* --rate 5hz"]
    for text in ("{", '{"boot_id":7,"rules":[["nav/*","Not a name",{"settings":[1.0]}]],"before":[]}'):
        (tmp_path / "broker.channels").write_text(text)
        caplog.clear()
        empty = ChannelTable()
        ChannelStore(empty, tmp_path, clock)
        assert empty.limits(S).limits == ()
        assert "no rule is in force" in caplog.text
        assert not (tmp_path / "broker.channels").exists()


def test_unwritable_rules_hold_until_broker_ends(
    table: ChannelTable, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = ChannelStore(table, tmp_path / "missing", Clock(boot_id=7))
    table.set(SetChannel("nav/*", ChannelSettings(5.0)), S)
    store.keep()
    assert "a restart of the broker loses the rules of channels" in caplog.text
