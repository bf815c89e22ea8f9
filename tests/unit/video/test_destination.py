"""Receivers as operators write them, and the session description for a standard receiver."""

import pytest

from swarmd.video.core.destination import Destination, session_description
from swarmware.errors import InvalidInput


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("gcs", Destination("gcs")),
        ("uav3.fc", Destination("uav3.fc")),
        ("10.0.0.1:5004", Destination(host="10.0.0.1", port=5004)),
        ("laptop.local:5004", Destination(host="laptop.local", port=5004)),
        ("[fe80::1]:5004", Destination(host="fe80::1", port=5004)),
    ],
)
def test_receiver_is_platform_or_address_with_its_port(text: str, expected: Destination) -> None:
    assert Destination.parse(text) == expected
    assert str(expected) == text


@pytest.mark.parametrize(
    "text", ["", "GCS", "10.0.0.1:", ":5004", "10.0.0.1:0", "10.0.0.1:65535", "h:port", "h:²"]
)
def test_anything_else_is_refused_with_what_was_expected(text: str) -> None:
    with pytest.raises(InvalidInput, match="expected"):
        Destination.parse(text)


def test_the_description_names_address_codec_and_clock() -> None:
    text = session_description(7, "camera", "10.0.0.1", 5004)
    assert text.splitlines() == [
        "v=0",
        "o=- 7 0 IN IP4 10.0.0.1",
        "s=camera",
        "c=IN IP4 10.0.0.1",
        "t=0 0",
        "m=video 5004 RTP/AVP 96",
        "a=rtpmap:96 H264/90000",
        "a=fmtp:96 packetization-mode=1",
        "a=recvonly",
    ]
    assert text.endswith("\r\n")
    assert "IN IP6 fe80::1" in session_description(7, "camera", "fe80::1", 5004)
