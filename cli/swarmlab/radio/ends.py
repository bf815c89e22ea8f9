"""What connects a radio with its nodes: TAP devices in namespaces, or sockets on loopback."""

from collections.abc import Callable, Iterable
from typing import Protocol

OnFrames = Callable[[int, Iterable[bytes]], None]
"""Called with the index of a node and Ethernet frames that it sends."""


class RadioEnds(Protocol):
    """Ends of a radio at its nodes."""

    def start(self, on_frames: OnFrames) -> None:
        """Begins to take frames from all nodes."""

    def write(self, receiver: int, frame: bytes) -> bool:
        """Hands a frame to a node; False when it takes none."""

    def close(self) -> None:
        """Removes the ends at all nodes."""
