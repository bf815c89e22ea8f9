"""Video of a real recording over the swarm: over two hops, as images again, with reported losses."""

from pathlib import Path

from tests.integration.broker.swarm import LINE, on_uvloop, swarm
from tests.integration.video.cameras import SIZE, sessions, until, video
from tests.patience import PATIENCE_S

from swarmware.types.channel import (
    ChannelLimits,
    ChannelProtocol,
    ChannelSettings,
    SetChannel,
    UndoChannel,
)
from swarmware.types.perception import Image, ImageEncoding
from swarmware.types.video import VideoRate, VideoSession, VideoSessions, VideoStart, VideoStop


@on_uvloop
async def test_a_recording_arrives_as_images_over_two_hops(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2", "uav3", hear=LINE) as line:
        await line["uav1"].until_reaches(uav3="uav2")
        await line["uav3"].until_reaches(uav1="uav2")
        async with video(line["uav1"]), video(line["uav3"]):
            app = line["uav3"].app
            start = VideoStart("camera", "uav3", max_bit_s=1_500_000)
            sent = await app.request("/uav1/sys/video/start", start, VideoSession, timeout_s=PATIENCE_S)
            assert (sent.other, sent.path) == ("uav3", "video/uav1/camera")
            images = app.stream_reader("video/uav1/camera", Image)
            seen = [await images.next(timeout_s=PATIENCE_S) for _ in range(25)]
            assert {(one.width, one.height, one.encoding) for one in seen} == {(*SIZE, ImageEncoding.RGB8)}
            assert len({one.data for one in seen}) > 20
            (there,) = await until(line["uav1"], lambda found: found[0].round_trip_s is not None)
            (here,) = await sessions(line["uav3"])
            assert (here.session, here.source, here.other) == (there.session, "camera", "uav1")
            assert (here.lost, here.gaps, here.refused) == (0, 0, 0)
            traffic = await line["uav2"].traffic()
            assert traffic.forwarded_frames > here.packets / 2
            rate = VideoRate(sent.session, 300_000, pinned=True)
            pinned = await app.request("/uav1/sys/video/rate", rate, VideoSession, timeout_s=PATIENCE_S)
            assert (pinned.bit_s, pinned.pinned) == (300_000, True)
            stopped = await app.request(
                "/uav1/sys/video/stop", VideoStop(sent.session), VideoSessions, timeout_s=PATIENCE_S
            )
            assert stopped.sessions[0].pictures >= 25
            assert await sessions(line["uav1"]) == ()
            await until(line["uav3"], lambda found: not found)


@on_uvloop
async def test_channel_rule_sends_camera_as_video(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "gcs", roles={"gcs": "operator"}) as pair:
        await pair["uav1"].until_reaches(gcs="gcs")
        async with video(pair["uav1"]), video(pair["gcs"]):
            app = pair["gcs"].app
            settings = ChannelSettings(10.0, ChannelProtocol.RTP, "h264")
            rule = SetChannel("camera", settings, link="gcs")
            await app.request("/uav1/sys/broker/set_channel", rule, ChannelLimits, timeout_s=PATIENCE_S)
            await until(pair["gcs"], lambda found: bool(found) and found[0].pictures > 5)
            (there,) = await sessions(pair["uav1"])
            (here,) = await sessions(pair["gcs"])
            assert (there.other, here.path) == ("gcs", "video/uav1/camera")
            images = app.stream_reader(here.path, Image)
            await images.next(timeout_s=PATIENCE_S)
            assert images.meta is not None
            first_ns = images.meta.stamp_ns
            for _ in range(10):
                await images.next(timeout_s=PATIENCE_S)
            assert images.meta.stamp_ns - first_ns > 0.7e9, "ten pictures a second of twenty-five"
            await app.request(
                "/uav1/sys/broker/undo_channel", UndoChannel(), ChannelLimits, timeout_s=PATIENCE_S
            )
            for station in pair.values():
                await until(station, lambda found: not found)
