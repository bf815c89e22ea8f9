"""Settings of the video daemon (services/video.toml)."""

from typing import Annotated

import msgspec

from swarmware.errors import InvalidInput

Positive = Annotated[float, msgspec.Meta(gt=0)]


class VideoSource(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A source of video, either a file or a stream of images."""

    resource: str = ""
    """Local path of a stream of images, such as a camera publishes."""
    file: str = ""
    """Path of a recording that PyAV can read; the recording is repeated from its end."""
    rate_hz: Positive = 25.0
    """Pictures per second of the stream; a file has its own rate."""

    def __post_init__(self) -> None:
        """Checks that the source has one origin; msgspec converts ValueError to its ValidationError."""
        if bool(self.resource) == bool(self.file):
            raise InvalidInput("a source needs either `resource` or `file`")


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Sources, encoder, and limits of video sessions."""

    sources: dict[str, VideoSource] = {}
    """Sources by name; a stream of images needs no entry."""
    encoder: str = "libx264"
    """Encoder of PyAV: libx264, or an encoder of the hardware (h264_v4l2m2m, h264_nvenc, h264_qsv)."""
    sessions_max: Annotated[int, msgspec.Meta(ge=1, le=64)] = 4
    """Maximum number of sent sessions, and of received sessions, at the same time."""
    guard_bit_s: Annotated[float, msgspec.Meta(ge=0, le=1e9)] = 500_000.0
    """Rate to which a link may fall suddenly while its queue stays below about 0.2 s, or 0 for no limit. At
    most 0.2 s of data at this rate is in flight, which limits the rate of video over long round trips."""
    wait_s: Positive = 0.06
    """Time to wait for a missing packet before it counts as lost."""
    silence_s: Positive = 30.0
    """Time without packets or reports after which a session ends."""
