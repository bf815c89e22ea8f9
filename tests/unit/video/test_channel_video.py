"""Video by rules of channels: started, ended, and started again."""

from swarmd.video.core.channel_video import RETRY_NS, Channel, ChannelVideo, StartVideo, StopVideo
from swarmware.types.channel import ChannelLimit, ChannelProtocol, ChannelSettings

S = 1_000_000_000
RTP = ChannelSettings(protocol=ChannelProtocol.RTP)
RULE = ChannelLimit("sensor/*", RTP, link="g*")
GCS = Channel("sensor/camera", "gcs")
SOURCES = {"sensor/camera", "nav/map"}
PLATFORMS = {"gcs", "uav2"}


def test_a_rule_starts_the_video_of_its_sources_to_its_platforms_once() -> None:
    video = ChannelVideo()
    assert video.changes([RULE], SOURCES, PLATFORMS, [], 0) == [StartVideo(GCS, None)]
    assert video.changes([RULE], SOURCES, PLATFORMS, [GCS], S) == []
    assert video.is_busy


def test_without_the_rule_its_video_ends_and_that_of_an_operator_stays() -> None:
    video, other = ChannelVideo(), Channel("nav/map", "gcs")
    video.changes([RULE], SOURCES, PLATFORMS, [other], 0)
    assert video.changes([], SOURCES, PLATFORMS, [GCS, other], S) == [StopVideo(GCS)]
    assert video.changes([], SOURCES, PLATFORMS, [other], 2 * S) == []
    assert not video.is_busy


def test_video_that_an_operator_has_started_is_not_started_again_and_not_ended() -> None:
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


def test_a_session_that_has_ended_is_started_again_when_its_platform_is_in_reach() -> None:
    video = ChannelVideo()
    video.changes([RULE], SOURCES, PLATFORMS, [], 0)
    assert video.changes([RULE], SOURCES, {"uav2"}, [], S) == []
    assert video.changes([RULE], SOURCES, PLATFORMS, [], 2 * S) == [StartVideo(GCS, None)]


def test_a_start_that_has_failed_is_tried_again_later() -> None:
    video = ChannelVideo()
    video.changes([RULE], SOURCES, PLATFORMS, [], 0)
    video.on_failed(GCS, 0)
    assert video.changes([RULE], SOURCES, PLATFORMS, [], RETRY_NS - 1) == []
    assert video.changes([RULE], SOURCES, PLATFORMS, [], RETRY_NS) == [StartVideo(GCS, None)]
