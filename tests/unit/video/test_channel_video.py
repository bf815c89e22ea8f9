"""Video by rules of channels: started, ended, and started again."""

from swarmd.video.core.channel_video import RETRY_NS, Channel, ChannelVideo, StartVideo, StopVideo
from swarmware.types.channel import ChannelLimit, ChannelProtocol, ChannelSettings

S = 1_000_000_000
RTP = ChannelSettings(protocol=ChannelProtocol.RTP)
RULE = ChannelLimit("sensor/*", RTP, link="g*")
GCS = Channel("sensor/camera", "gcs")
SOURCES = {"sensor/camera", "nav/map"}
PLATFORMS = {"gcs", "uav2"}


def test_rule_starts_video_to_platforms_once() -> None:
    video = ChannelVideo()
    assert video.changes([RULE], SOURCES, PLATFORMS, [], 0) == [StartVideo(GCS, None)]
    assert video.changes([RULE], SOURCES, PLATFORMS, [GCS], S) == []
    assert video.is_busy


def test_missing_rule_ends_only_its_video() -> None:
    video, other = ChannelVideo(), Channel("nav/map", "gcs")
    video.changes([RULE], SOURCES, PLATFORMS, [other], 0)
    assert video.changes([], SOURCES, PLATFORMS, [GCS, other], S) == [StopVideo(GCS)]
    assert video.changes([], SOURCES, PLATFORMS, [other], 2 * S) == []
    assert not video.is_busy


def test_operators_video_is_neither_restarted_nor_ended() -> None:
    video = ChannelVideo()
    assert video.changes([RULE], SOURCES, PLATFORMS, [GCS], 0) == []
    assert video.changes([], SOURCES, PLATFORMS, [GCS], S) == []


def test_another_rate_starts_the_video_again() -> None:
    video = ChannelVideo()
    video.changes([RULE], SOURCES, PLATFORMS, [], 0)
    slow = ChannelLimit("sensor/*", ChannelSettings(5.0, compression="h264"), link="gcs")
    assert video.changes([slow, RULE], SOURCES, PLATFORMS, [GCS], S) == [StopVideo(GCS), StartVideo(GCS, 5.0)]
    silent = ChannelLimit("sensor/*", ChannelSettings(0.0))
    assert video.changes([silent, RULE], SOURCES, PLATFORMS, [GCS], 2 * S) == [StopVideo(GCS)]


def test_ended_session_restarts_when_platform_is_reachable() -> None:
    video = ChannelVideo()
    video.changes([RULE], SOURCES, PLATFORMS, [], 0)
    assert video.changes([RULE], SOURCES, {"uav2"}, [], S) == []
    assert video.changes([RULE], SOURCES, PLATFORMS, [], 2 * S) == [StartVideo(GCS, None)]


def test_start_that_has_failed_is_tried_again_later() -> None:
    video = ChannelVideo()
    video.changes([RULE], SOURCES, PLATFORMS, [], 0)
    video.on_failed(GCS, 0)
    assert video.changes([RULE], SOURCES, PLATFORMS, [], RETRY_NS - 1) == []
    assert video.changes([RULE], SOURCES, PLATFORMS, [], RETRY_NS) == [StartVideo(GCS, None)]
