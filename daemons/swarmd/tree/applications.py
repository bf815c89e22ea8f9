"""The applications of this node: told when one of them comes, goes or changes."""

from collections.abc import Callable

from swarmware.appfile import AppTable
from swarmware.node import Node
from swarmware.node.node import APPS_TABLE


class Applications:
    """Looks at the application files whenever the doorbell has rung."""

    def __init__(self, node: Node, tell: Callable[[], None]) -> None:
        self._node = node
        self._tell = tell
        self._bells = node.shm_dir / APPS_TABLE
        # of our own: the node's table is refreshed by others, who then know of the change and we do not
        self.table = AppTable(node.run_dir)
        node.listen(self._bells)
        node.watch(self)
        self.table.refresh(probe=True)

    def poll(self) -> None:
        """The doorbell has rung, perhaps for us."""
        if self.table.refresh():
            self._tell()

    def probe(self) -> None:
        """Look for those that died without a word."""
        if self.table.refresh(probe=True):
            self._tell()

    def close(self) -> None:
        """Looks no more."""
        self._node.unwatch(self)
        self._node.unlisten(self._bells)
