"""Mirrors of boards that change between notifications and beacons: tree and broker write them in turn."""

from pathlib import Path

from swarmd.tree.core.action import WriteMirror
from swarmd.tree.exchange.mirrors import Mirrors
from swarmware.model.frame import Frame, FrameKind
from swarmware.model.names import data_id, hardware_id
from swarmware.node.mirror_writer import MirrorWriter
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.net import BoardSubscription
from swarmware.types.tree_exchange import TreeItem

PATH, TYPE = "power/fuel", "Float"
ID = data_id(PATH, TYPE)


def notified(sequence: int) -> WriteMirror:
    return WriteMirror("uav2", TreeItem(PATH, ID, FrameKind.BOARD, sequence, sequence, b"\x01"), 1)


def received(stamp_ns: int) -> Frame:
    """A value as the broker writes it."""
    return Frame(FrameKind.BOARD, ID, hardware_id("uav2"), stamp_ns=stamp_ns, payload=b"\x02")


async def test_late_notification_does_not_keep_beacons_from_mirror(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        tree, broker = Mirrors(node), MirrorWriter(node)
        tree.write(notified(1))
        tree.leave([BoardSubscription("uav2", PATH, TYPE, ID)])
        tree.write(notified(2))
        assert broker.write("uav2", PATH, received(3))
        tree.write(notified(4))  # the broker writes the mirror now: it waits
        assert tree.written == 2
        broker.keep_only([])
        tree.leave([])
        tree.write(notified(5))
        tree.write(notified(6))
        assert tree.written == 4
        tree.close()
        broker.close()
