"""Writer of a stream or of events, with the losses of its subscribers."""

from collections.abc import Mapping
from typing import Final, TypeVar

import msgspec

from swarmware.model.names import data_id
from swarmware.model.resource import Resource
from swarmware.module.board import BoardReader
from swarmware.module.remote_clocks import RemoteClocks
from swarmware.module.writer import BoardWriter
from swarmware.node.node import Node
from swarmware.node.publication import Publication
from swarmware.types.tree_exchange import StreamLosses

T = TypeVar("T", bound=msgspec.Struct)

LOSSES: Final = "tree/losses"
STREAM_SLOTS: Final = 256
STREAM_SLOT_BYTES: Final = 2048


class StreamWriter(BoardWriter[T]):
    """Publishes every item of one stream or event of this platform."""

    def __init__(
        self,
        node: Node,
        app_id: int,
        resource: Resource,
        cls: type[T],
        publication: Publication,
        remote_clocks: RemoteClocks,
    ) -> None:
        super().__init__(node, app_id, resource, cls, publication)
        self._node = node
        self._remote_clocks = remote_clocks
        self._losses: BoardReader[StreamLosses] | None = None

    @property
    def losses(self) -> Mapping[str, int]:
        """Platform → number of its lost items: the platform, or the link to it, was too slow.

        The tree of this node counts them since its start and publishes them every second. Without a tree none
        are counted.
        """
        if self._losses is None:
            identity = data_id(LOSSES, StreamLosses.__name__)
            self._losses = BoardReader(self._node, LOSSES, StreamLosses, identity, self._remote_clocks)
        reported = self._losses.value or StreamLosses()
        return {one.platform: one.items for one in reported.losses if one.path == self.path}

    @property
    def lost(self) -> int:
        """Number of items lost at all subscribers together."""
        return sum(self.losses.values())

    def close(self, *, unlink: bool = True) -> None:
        """Stop publishing, as the writer of a board does."""
        if self._losses is not None:
            self._losses.close()
            self._losses = None
        super().close(unlink=unlink)
