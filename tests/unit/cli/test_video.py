"""`swarmctl video`: what is asked of the node, what is printed, and rates as they are typed."""

from pathlib import Path
from typing import Any

import pytest
from tests.unit.cli.session import ScriptedSession

from swarmctl.commands.video import sessions
from swarmctl.terminal.quantities import bit_s
from swarmware.errors import InvalidInput, NotFound, OutOfRange
from swarmware.types.video import VideoDirection, VideoRateChange, VideoSession, VideoSessions

SENT = VideoSession(
    70,
    VideoDirection.SENT,
    "camera",
    "gcs",
    path="video/uav1/camera",
    bit_s=850_000,
    max_bit_s=1_000_000,
    pictures=250,
    skipped=3,
    dropped=1,
    packets=1_200,
    lost=7,
    queueing_s=0.012,
    waiting_s=0.03,
    changes=(VideoRateChange(0, 1_000_000, "begin"), VideoRateChange(1, 850_000, "queue of 80 ms")),
)
TO_ADDRESS = VideoSession(71, VideoDirection.SENT, "camera", "10.0.0.7:5004", sdp="v=0\r\ns=camera\r\n")
RECEIVED = VideoSession(72, VideoDirection.RECEIVED, "front", "uav2", pictures=9, packets=40, lost=2)


class VideoNode(ScriptedSession):
    """A node that knows no other platform than a ground station."""

    async def reach(self, platform: str) -> None:
        if platform != "gcs":
            raise NotFound(f"node {platform!r}: not known to gcs")


def scripted(**answers: Any) -> ScriptedSession:
    return VideoNode({f"sys/video/{name}": found for name, found in answers.items()})


async def test_session_to_platform_names_stream_of_its_images() -> None:
    session = scripted(start=SENT)
    await sessions.start(session, "camera", "gcs", 1_000_000, False, None)
    assert session.stdout.getvalue() == "session 70: camera of gcs to gcs\nimages: /gcs/video/uav1/camera\n"


async def test_session_to_address_shows_commands_of_receivers(tmp_path: Path) -> None:
    file = tmp_path / "camera.sdp"
    session = scripted(start=TO_ADDRESS)
    await sessions.start(session, "camera", "10.0.0.7:5004", 1_000_000, False, file)
    assert file.read_bytes() == TO_ADDRESS.sdp.encode()
    printed = session.stdout.getvalue()
    assert f"ffplay -protocol_whitelist file,udp,rtp -fflags nobuffer -flags low_delay -i {file}" in printed
    assert "udpsrc port=5004" in printed
    session = scripted(start=TO_ADDRESS)
    await sessions.start(session, "camera", "10.0.0.7:5004", 1_000_000, False, None)
    assert "s=camera" in session.stdout.getvalue()


async def test_impossible_receiver_or_rate_is_refused_at_once() -> None:
    session = scripted(start=SENT)
    with pytest.raises(NotFound, match="node 'nobody': not known"):
        await sessions.start(session, "camera", "nobody", 1_000_000, False, None)
    assert session.asked == []
    assert sessions.bitrate_bit_s("500kbit") == 500_000
    for text in ("100gbit", "5bit"):
        with pytest.raises(OutOfRange, match=f"rate {text}: expected 1kbit to 1gbit"):
            sessions.bitrate_bit_s(text)


async def test_a_description_is_only_for_an_address() -> None:
    session = scripted(start=SENT)
    with pytest.raises(InvalidInput, match="expected --to HOST:PORT"):
        await sessions.start(session, "camera", "gcs", 1_000_000, False, Path("camera.sdp"))
    assert session.asked == []


async def test_list_shows_rate_losses_and_reason() -> None:
    session = scripted(ls=VideoSessions((SENT, RECEIVED), refused=4))
    await sessions.list_sessions(session)
    head, sent, received, refused = session.stdout.getvalue().splitlines()
    assert head.split()[:3] == ["SESSION", "SOURCE", "WAY"]
    columns = ["850", "1000", "250", "4", "1200", "7", "42", "queue of 80 ms"]
    assert sent.split() == ["70", "camera", "to", "gcs", *" ".join(columns).split()]
    assert received.split() == ["72", "front", "from", "uav2", "-", "-", "9", "0", "40", "2", "-", "-"]
    assert refused == "refused: 4 packets of no session"


async def test_without_sessions_the_list_says_so() -> None:
    session = scripted(ls=VideoSessions())
    await sessions.list_sessions(session)
    assert "no video" in session.stdout.getvalue() + session.stderr.getvalue()


async def test_rate_and_stop_print_what_the_node_answers() -> None:
    session = scripted(rate=SENT, stop=VideoSessions((SENT,)))
    await sessions.set_rate(session, 70, 1_000_000, False)
    assert session.stdout.getvalue() == "session 70: at most 1000 kbit/s, now 850\n"
    await sessions.stop(session, 70)
    assert "camera" in session.stdout.getvalue()
    assert session.asked == ["sys/video/rate", "sys/video/stop"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [("1mbit", 1_000_000), ("1.5Mbit", 1_500_000), ("250kbit", 250_000), ("64000bit", 64_000)],
)
def test_a_bit_rate_has_its_unit(text: str, expected: int) -> None:
    assert bit_s(text) == expected


@pytest.mark.parametrize("text", ["", "1", "1mb", "0mbit", "-1mbit", "auto", "1mbit/s"])
def test_another_text_is_no_bit_rate(text: str) -> None:
    with pytest.raises(InvalidInput, match="expected 1mbit or 250kbit"):
        bit_s(text)
