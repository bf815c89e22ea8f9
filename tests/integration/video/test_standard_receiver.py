"""FFmpeg and GStreamer, as standard receivers, show the RTP of the daemon."""

import asyncio
import shlex
import shutil
from pathlib import Path

import pytest
from tests.integration.broker.swarm import on_uvloop, swarm
from tests.integration.video.cameras import SIZE, sessions, video
from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmctl.commands.video.sessions import receivers
from swarmware.types.video import VideoSession, VideoStart

PICTURES = 30


@on_uvloop
async def test_ffmpeg_decodes_the_video_by_its_session_description(tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg", reason="no FFmpeg program here")
    import imageio_ffmpeg

    program: str = imageio_ffmpeg.get_ffmpeg_exe()
    async with swarm(tmp_path, "uav1") as nodes, video(nodes["uav1"]):
        port = free_port()  # it is even; the next one is for reports
        start = VideoStart("camera", f"127.0.0.1:{port}", max_bit_s=1_000_000)
        sent = await nodes["uav1"].app.request("sys/video/start", start, VideoSession, timeout_s=PATIENCE_S)
        description = tmp_path / "camera.sdp"
        description.write_text(sent.sdp)
        words = ["-hide_banner", "-loglevel", "error", "-protocol_whitelist", "file,udp,rtp", "-i"]
        frames = tmp_path / "frames.rgb"
        receiver = await asyncio.create_subprocess_exec(
            program,
            *words,
            str(description),
            *f"-frames:v {PICTURES} -f rawvideo -pix_fmt rgb24 {frames}".split(),
            stderr=asyncio.subprocess.PIPE,
        )
        try:
            # it begins in the middle: it shows nothing before the next key frame
            _, said = await asyncio.wait_for(receiver.communicate(), 60)
        finally:
            if receiver.returncode is None:
                receiver.kill()
        assert receiver.returncode == 0, said.decode()
        assert len(frames.read_bytes()) == PICTURES * SIZE[0] * SIZE[1] * 3
        (session,) = await sessions(nodes["uav1"])
        assert session.pictures > PICTURES
        assert session.refused == 0


@on_uvloop
async def test_gstreamer_decodes_the_video_by_the_printed_command(tmp_path: Path) -> None:
    program = shutil.which("gst-launch-1.0")
    if program is None:
        pytest.skip("no gst-launch-1.0 here (Debian: gstreamer1.0-tools, -plugins-good, -libav)")
    frames = tmp_path / "frames.rgb"
    shown = (
        f"identity eos-after={PICTURES} ! videoconvert ! video/x-raw,format=RGB ! filesink location={frames}"
    )
    async with swarm(tmp_path, "uav1") as nodes, video(nodes["uav1"]):
        start = VideoStart("camera", f"127.0.0.1:{free_port()}", max_bit_s=1_000_000)
        sent = await nodes["uav1"].app.request("sys/video/start", start, VideoSession, timeout_s=PATIENCE_S)
        [printed] = [line for line in receivers(sent, tmp_path) if line.startswith("gst-launch-1.0")]
        words = shlex.split(printed.replace("autovideosink", shown))[1:]
        receiver = await asyncio.create_subprocess_exec(
            program, *words, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
        )
        try:
            said, _ = await asyncio.wait_for(receiver.communicate(), 60)
        finally:
            if receiver.returncode is None:
                receiver.kill()
        assert receiver.returncode == 0, said.decode()
        got = len(frames.read_bytes()) / (SIZE[0] * SIZE[1] * 3)
        assert got in (PICTURES - 1, PICTURES), said.decode()
