"""Video sessions: set up by a request to the node of the source, sent as RTP, shown with their counters."""

from typing import Annotated, Final

import msgspec

from swarmware.model.open_enum import OpenEnum
from swarmware.types.registry import register

BITRATES_BIT_S: Final = (1_000, 1_000_000_000)
"""Lowest and highest rate of an encoder."""
BitRate = Annotated[int, msgspec.Meta(ge=BITRATES_BIT_S[0], le=BITRATES_BIT_S[1])]
"""In bit/s."""


@register
class RtpDatagram(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One packet of a video session, RTP or RTCP, to `sys/video/rtp`."""

    data: bytes


@register
class VideoStart(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Send a source as video (`sys/video/start`)."""

    source: str
    """Name of a source of the node's configuration, or local path of a stream of images."""
    to: str
    """A platform, or HOST:PORT of a standard receiver."""
    max_bit_s: BitRate = 2_000_000
    """Highest rate of the encoder."""
    pinned: bool = False
    """The rate stays, whatever the link carries."""


@register
class VideoRate(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Another rate for a session of the node (`sys/video/rate`)."""

    session: int
    max_bit_s: BitRate
    pinned: bool = False
    """The rate stays, whatever the link carries."""


@register
class VideoStop(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """End a session of the node, sent or received (`sys/video/stop`)."""

    session: int


@register
class VideoOpen(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A platform will send video (`sys/video/open`)."""

    session: int
    """Source of its RTP packets (SSRC)."""
    sender: str
    """Computer that sends, `uav3` or `uav3.fc`."""
    source: str
    """Name or local path of the source."""


@register
class VideoOpened(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The receiving platform is ready."""

    receiver: str
    """Computer of the receiving platform."""
    path: str
    """Path of the stream of images."""


class VideoDirection(OpenEnum):
    """Whether a node sends or receives."""

    SENT = "sent"
    RECEIVED = "received"


@register
class VideoRateChange(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One change of the rate of an encoder."""

    at_ns: int
    bit_s: int
    reason: str
    """`free`, `queue of 80 ms`, `loss of 12%`, `no reports`, `pinned`."""


@register
class VideoSession(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One session with its counters since its beginning."""

    session: int
    direction: VideoDirection
    source: str
    other: str
    """Other end of the session: destination or origin."""
    path: str = ""
    """Stream of the images at the receiving platform."""
    started_ns: int = 0
    bit_s: int = 0
    """Present rate of the encoder."""
    max_bit_s: int = 0
    pinned: bool = False
    pictures: int = 0
    skipped: int = 0
    """Pictures not encoded, because packets waited for the link."""
    packets: int = 0
    octets: int = 0
    """Bytes of RTP payloads sent, of packets received."""
    lost: int = 0
    """Packets that did not arrive."""
    gaps: int = 0
    dropped: int = 0
    """Received pictures that could not be decoded; sent packets that waited too long."""
    key_frames_asked: int = 0
    refused: int = 0
    """Packets that were damaged or of another session."""
    queueing_s: float = 0.0
    """Queue in the link, by the round trips."""
    waiting_s: float = 0.0
    """Age of the oldest packet before the link."""
    round_trip_s: float | None = None
    jitter_s: float = 0.0
    changes: tuple[VideoRateChange, ...] = ()
    """Newest changes of the rate, the newest last."""
    sdp: str = ""
    """Session description for a standard receiver (RFC 8866)."""


@register
class VideoSessions(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """All sessions of a node."""

    sessions: tuple[VideoSession, ...] = ()
    refused: int = 0
    """Datagrams of no session."""


@register
class VideoChange(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A session was started, changed or ended (event `video/changes`)."""

    session: int
    source: str
    other: str
    change: str
    by: str = ""
    """Requester, or "" for the node itself."""
