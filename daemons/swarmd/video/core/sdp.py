"""Session description (RFC 8866) of H.264 over RTP (RFC 6184, section 8.2), for a standard receiver."""

from swarmd.video.core.rtp_packet import CLOCK_HZ, PAYLOAD_TYPE


def describe(session: int, name: str, host: str, port: int) -> str:
    """The description of one session, whose receiver has this address."""
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
