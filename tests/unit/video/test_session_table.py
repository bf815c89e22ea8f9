"""Sessions of a node: limits, one session per source and receiver, and the session of a packet."""

import pytest

from swarmd.video.core import rtcp, rtp_packet
from swarmd.video.core.receiver import receiver_ssrc
from swarmd.video.core.rtcp import Bye, KeyFrameRequest, PacketArrivals, ReceiverReport, SenderReport
from swarmd.video.core.rtp_packet import RtpPacket
from swarmd.video.core.session_table import SessionKey, SessionTable
from swarmware.errors import Conflict, OutOfRange

GCS, UAV2, STRANGER = 100, 102, 103


def table() -> SessionTable[str, str]:
    """Sends session 70 to gcs and 80 to an address, receives 90 from uav2."""
    made: SessionTable[str, str] = SessionTable(2)
    made.add_sent(70, "camera", "gcs", GCS, "to gcs")
    made.add_sent(80, "camera", "10.0.0.1:5004", None, "to address")
    made.add_received(SessionKey(UAV2, 90), "front", "uav2", "from uav2")
    return made


@pytest.mark.parametrize(
    ("data", "sender_hw", "expected"),
    [
        (rtp_packet.encode(RtpPacket(1, 0, 90, b"\x41")), UAV2, "from uav2"),
        (rtp_packet.encode(RtpPacket(1, 0, 90, b"\x41")), STRANGER, None),
        (rtp_packet.encode(RtpPacket(1, 0, 70, b"\x41")), GCS, None),
        (rtcp.encode(SenderReport(90, 0, 0, 0, 0)), UAV2, "from uav2"),
        (rtcp.encode(Bye(90)), UAV2, "from uav2"),
        (rtcp.encode(KeyFrameRequest(71, 70)), GCS, "to gcs"),
        (rtcp.encode(PacketArrivals(71, 70, 0, (0,))), GCS, "to gcs"),
        (rtcp.encode(ReceiverReport(71, 70, 0, 0, 0, 0, 0, 0)), GCS, "to gcs"),
        (rtcp.encode(Bye(receiver_ssrc(70))), GCS, "to gcs"),
        (rtcp.encode(Bye(receiver_ssrc(70))), STRANGER, None),
        (rtcp.encode(KeyFrameRequest(71, 70)), STRANGER, None),
        (rtcp.encode(KeyFrameRequest(81, 80)), GCS, None),
        (rtcp.encode(KeyFrameRequest(1, 2)), GCS, None),
        (rtcp.description(90, "name"), UAV2, None),
        (b"garbage", UAV2, None),
        (b"", UAV2, None),
    ],
)
def test_packet_belongs_to_session_of_exactly_this_sender(
    data: bytes, sender_hw: int, expected: str | None
) -> None:
    made = table()
    assert made.find(data, sender_hw) == expected
    assert made.refused == (expected is None)


def test_source_goes_once_and_within_limit() -> None:
    made = table()
    with pytest.raises(Conflict, match="camera: sent to gcs already"):
        made.check_sent("camera", "gcs")
    with pytest.raises(OutOfRange, match="at most 2"):
        made.check_sent("front", "gcs")
    made.remove(70)
    made.check_sent("camera", "gcs")


def test_restarted_sender_replaces_session_without_room() -> None:
    made = table()
    assert made.replaced("rear", "uav2") is None
    made.add_received(SessionKey(UAV2, 91), "rear", "uav2", "rear of uav2")
    assert made.replaced("front", "uav2") == SessionKey(UAV2, 90)
    with pytest.raises(OutOfRange):
        made.replaced("front", "uav3")
    made.remove(SessionKey(UAV2, 90))
    assert made.replaced("front", "uav3") is None
