"""A module's boards and a node are open at once, without `await`, and closed by their last user."""

from pathlib import Path

from swarmware.module.module import Module
from swarmware.node.node import Node
from swarmware.testing.tmpnode import make_node, tmp_node
from swarmware.types.scalar import Float


async def test_boards_of_a_module_are_open_at_once(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        writer, reader = m.writer("nav/height", Float), m.reader("nav/height", Float)
        writer.write(Float(2.0))
        assert reader.value == Float(2.0)


async def test_a_node_is_closed_by_its_last_user(tmp_path: Path) -> None:
    folder = make_node(tmp_path)
    node = Node.attach(folder)
    assert node.share() is node
    node.close()
    assert Node.attach(folder) is node, "one user is left"
    node.close()
    node.close()
    other = Node.attach(folder)
    assert other is not node, "the last user has left"
    other.close()
