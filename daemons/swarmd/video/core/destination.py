"""Destinations of video: a platform, or a standard receiver, which needs a session description."""

import msgspec

from swarmd.video.core.rtp_packet import CLOCK_HZ, PAYLOAD_TYPE
from swarmware.errors import InvalidInput
from swarmware.model import names


class Destination(msgspec.Struct, frozen=True):
    """Receiver of a session: a platform, or a host with a port."""

    platform: str = ""
    """Name of a platform or of one of its computers, or "" if the receiver is an address."""
    host: str = ""
    port: int = 0

    @classmethod
    def parse(cls, text: str) -> "Destination":
        """Parses a platform, HOST:PORT, or [IPv6 address]:PORT.

        Raises: InvalidInput.
        """
        # the last colon, since IPv6 addresses contain colons
        host, colon, port = text.rpartition(":")
        if not colon:
            return cls(platform=names.check_computer(text))
        host = host.removeprefix("[").removesuffix("]")
        # the next higher port receives the reports
        if not host or not port.isascii() or not port.isdigit() or not 0 < int(port) < 0xFFFF:
            raise InvalidInput(f"receiver {text!r}: expected a platform, or HOST:PORT with a port to 65534")
        return cls(host=host, port=int(port))

    def __str__(self) -> str:
        return self.platform or (
            f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"
        )


def session_description(session: int, name: str, host: str, port: int) -> str:
    """SDP description (RFC 8866, RFC 6184) of a session, for a receiver with this address."""
    family = "IP6" if ":" in host else "IP4"
    lines = (
        "v=0",
        f"o=- {session} 0 IN {family} {host}",
        f"s={name}",
        f"c=IN {family} {host}",
        "t=0 0",
        f"m=video {port} RTP/AVP {PAYLOAD_TYPE}",
        f"a=rtpmap:{PAYLOAD_TYPE} H264/{CLOCK_HZ}",
        f"a=fmtp:{PAYLOAD_TYPE} packetization-mode=1",
        "a=recvonly",
    )
    return "".join(f"{line}\r\n" for line in lines)
