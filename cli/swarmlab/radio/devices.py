"""TAP devices of all nodes of a lab, each in the network namespace of its node."""

import asyncio
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final

from swarmctl.session.labs import LabNode
from swarmlab.radio.namespace import NodeNamespace, enter_user_namespace, user_namespace

TURN: Final = 64
"""Maximum frames of one node that are read before the next node's."""

OnFrames = Callable[[int, Iterable[bytes]], None]
"""Called with the index of a node and Ethernet frames that it sends."""


class NamespaceDevices:
    """Devices that carry the frames of the nodes, and links by which nodes enter their namespaces."""

    def __init__(self, nodes: Sequence[LabNode], ethernet: Sequence[bytes]) -> None:
        """Raises: Denied without the rights."""
        self._namespaces: list[NodeNamespace] = []
        # before the first network namespace, which belongs to the user namespace in which it is made
        if as_user := {node.user_namespace for node in nodes} - {""}:
            enter_user_namespace()
        try:
            for link in as_user:
                _link(link, user_namespace())
            for node, address in zip(nodes, ethernet, strict=True):
                self._namespaces.append(NodeNamespace(node.address, address))
                _link(node.namespace, self._namespaces[-1].path)
        except BaseException:
            self.close()
            raise

    def start(self, on_frames: OnFrames) -> None:
        """Begins to take frames from all nodes."""
        loop = asyncio.get_running_loop()
        for index, namespace in enumerate(self._namespaces):
            loop.add_reader(namespace.fileno(), self._on_readable, index, on_frames)

    def _on_readable(self, index: int, on_frames: OnFrames) -> None:
        on_frames(index, self._frames(index))

    def _frames(self, index: int) -> Iterator[bytes]:
        read = self._namespaces[index].read
        # bounded, so that a node that floods does not starve the others
        for _ in range(TURN):
            data = read()
            if data is None:
                return
            yield data

    def write(self, receiver: int, frame: bytes) -> bool:
        """Hands a frame to a node; False when its device is down or full."""
        return self._namespaces[receiver].write(frame)

    def close(self) -> None:
        """Removes the devices of all nodes."""
        for namespace in self._namespaces:
            namespace.close()


def _link(path: str, target: str) -> None:
    link = Path(path)
    # a former radio of this lab that was killed leaves its link, whose target has ended
    link.unlink(missing_ok=True)
    link.symlink_to(target)
