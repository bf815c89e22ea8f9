"""Settings of the video daemon."""

from typing import Annotated

import msgspec

from swarmware.errors import InvalidInput

Positive = Annotated[float, msgspec.Meta(gt=0)]


class VideoSource(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A source of video: a file, or a stream of images."""

    resource: str = ""
    """Local path of a stream of images, as a camera publishes it."""
    file: str = ""
    """Recording that PyAV reads; it is repeated at its end."""
    rate_hz: Positive = 25.0
    """Pictures per second of the stream; a file has its own rate."""

    def __post_init__(self) -> None:
        """Check that it has one origin; msgspec converts ValueError to its ValidationError."""
        if bool(self.resource) == bool(self.file):
            raise InvalidInput("a source needs either `resource` or `file`")


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings from services/video.toml."""

    sources: dict[str, VideoSource] = {}
    """Sources by name; streams of images need no entry."""
    encoder: str = "libx264"
    """Encoder of PyAV: libx264, or one of the hardware (h264_v4l2m2m, h264_nvenc, h264_qsv)."""
    sessions_max: Annotated[int, msgspec.Meta(ge=1, le=64)] = 4
    """Sessions sent, and sessions received, at the same time."""
    guard_bit_s: Annotated[float, msgspec.Meta(ge=0, le=1e9)] = 500_000.0
    """Rate to which a link may fall at once while its queue stays below about 0.2 s: at most what takes that
    time is in flight, which limits the rate of video over long round trips. 0: no such limit."""
    wait_s: Positive = 0.06
    """Time for which a missing packet is waited for."""
    silence_s: Positive = 30.0
    """Time without packets or reports after which a session ends."""
