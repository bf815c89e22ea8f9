"""Counters that both ends of a session have, and their part of its report."""

import msgspec

from swarmware.types.video import VideoDirection, VideoSession


class SessionCounters(msgspec.Struct):
    """What one end of a session did."""

    pictures: int = 0
    packets: int = 0
    octets: int = 0
    lost: int = 0
    """Packets that did not arrive: as the receiver reported, or missing when their turn came."""
    key_frames_asked: int = 0
    refused: int = 0
    """Packets of another format or source, and damaged ones."""

    def report(
        self,
        number: int,
        direction: VideoDirection,
        source: str,
        other: str,
        path: str,
        started_ns: int,
    ) -> VideoSession:
        """The session with these counters; each end adds what it alone knows."""
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
