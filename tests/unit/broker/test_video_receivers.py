"""Rules that make a channel video, for platforms where the service `video` does not run."""

import pytest

from swarmd.broker.core.boards.channel_table import QUESTION, without_video
from swarmware.errors import InvalidInput
from swarmware.model.names import Pattern
from swarmware.model.resource import Kind
from swarmware.types.channel import ChannelProtocol, ChannelSettings, SetChannel
from swarmware.types.tree import Quality, TreeEntry, TreeListing, TreePlatform

RTP = ChannelSettings(protocol=ChannelProtocol.RTP)


def listing(*able: str, quality: Quality = Quality.NONE, unknown: str = "", away: str = "") -> TreeListing:
    """As the tree of uav1 knows four platforms."""
    entries = (
        TreeEntry(f"/{platform}/sys/video/open", Kind.COMMAND, "VideoOpen", quality=quality)
        for platform in able
    )
    platforms = (
        TreePlatform(name, reachable=name != away, resources=9, digest=0 if name == unknown else 7)
        for name in ("uav1", "uav2", "uav3", "gcs")
    )
    return TreeListing(tuple(entries), platforms=tuple(platforms))


def named(link: str, known: TreeListing) -> list[str]:
    return [one.path for one in without_video(SetChannel("sensor/camera", RTP, link=link), "uav1", known)]


def test_the_question_names_the_address_of_each_platform() -> None:
    assert Pattern(QUESTION.pattern).matches("/gcs/sys/video/open")


def test_link_of_platforms_with_service_has_no_refusal() -> None:
    assert named("gcs", listing("gcs")) == []
    assert named("{gcs,uav2}", listing("gcs", "uav2")) == []
    assert named("uav9", listing()) == [], "it may come into reach"


def test_platforms_without_video_service_are_named() -> None:
    assert named("*", listing("gcs")) == ["/uav2", "/uav3"]
    (one, _) = without_video(SetChannel("sensor/camera", RTP, link="*"), "uav1", listing("gcs"))
    assert "service `video` does not run there" in one.reason


def test_rule_for_link_without_video_service_is_refused() -> None:
    for known in (listing("uav2"), listing("gcs", quality=Quality.LOST)):
        with pytest.raises(InvalidInput, match=r"link 'gcs': gcs: the service `video` does not run there"):
            named("gcs", known)


def test_unknown_or_unreachable_receiver_is_not_refused() -> None:
    assert named("gcs", listing(unknown="gcs")) == []
    assert named("gcs", listing(away="gcs")) == []
    assert named("{gcs,uav2}", listing("gcs", away="uav2")) == []
