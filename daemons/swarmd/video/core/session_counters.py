"""Counters that both ends of a session have in common, and their part of the report."""

import msgspec

from swarmware.types.video import VideoDirection, VideoSession


class SessionCounters(msgspec.Struct):
    """Counters of one end of a session."""

    pictures: int = 0
    packets: int = 0
    octets: int = 0
    lost: int = 0
    """Number of packets that did not arrive."""
    key_frames_asked: int = 0
    refused: int = 0
    """Number of packets that were damaged, or of another format or source."""

    def report(
        self,
        number: int,
        direction: VideoDirection,
        source: str,
        other: str,
        path: str,
        started_ns: int,
    ) -> VideoSession:
        """Report of the session with these counters, to which each end adds its own fields."""
        return VideoSession(
            number,
            direction,
            source,
            other,
            path=path,
            started_ns=started_ns,
            pictures=self.pictures,
            packets=self.packets,
            octets=self.octets,
            lost=self.lost,
            key_frames_asked=self.key_frames_asked,
            refused=self.refused,
        )
