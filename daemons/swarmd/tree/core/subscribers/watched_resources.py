"""Own resources that are watched, because other platforms subscribe to them by notification."""

from collections import Counter
from collections.abc import Callable, Collection, Mapping

from swarmd.tree.core.action import Action, Unwatch, Watch
from swarmd.tree.core.notification.feed import Feed
from swarmd.tree.core.subscribers.subscriber import Subscriber
from swarmware.types.tree_exchange import TreeItem


class WatchedResources:
    """Subscribers and newest value of each watched resource, by path."""

    def __init__(self, emit: Callable[[Action], None]) -> None:
        self._emit = emit
        self._readers: dict[str, dict[str, Subscriber]] = {}
        self._newest: dict[str, TreeItem] = {}
        self._lost: Counter[tuple[str, str]] = Counter()

    @property
    def newest(self) -> Mapping[str, TreeItem]:
        """The newest value of each resource that has one."""
        return self._newest

    @property
    def lost(self) -> Counter[tuple[str, str]]:
        """Number of items that feeds of the past have dropped, by resource and subscriber."""
        return self._lost.copy()

    def readers(self, path: str) -> Collection[Subscriber]:
        """The subscribers of a resource."""
        return self._readers.get(path, {}).values()

    def on_value(self, item: TreeItem) -> Collection[Subscriber]:
        """Add a value to the feeds of its resource; returns their subscribers."""
        readers = self.readers(item.path)
        if readers:
            self._newest[item.path] = item
        for one in readers:
            one.feeds[item.path].offer(item)
        return readers

    def replace(self, one: Subscriber, before: Mapping[str, Feed], feeds: Mapping[str, Feed]) -> None:
        """A subscriber has other feeds: watch exactly their resources."""
        for path, feed in before.items():
            if feeds.get(path) is not feed:
                self._lost[path, one.platform] += feed.lost
            if path not in feeds:
                self._remove(path, one)
        for path, feed in feeds.items():
            readers = self._readers.setdefault(path, {})
            changed = path in before and before[path].resource != feed.resource
            # the first reader opens the ring; later ones share it
            if not readers or changed:
                self._emit(Watch(feed.resource))
            if changed:
                self._newest.pop(path, None)  # its type may differ; the watch reads it again
            readers[one.platform] = one

    def _remove(self, path: str, one: Subscriber) -> None:
        readers = self._readers[path]
        del readers[one.platform]
        if not readers:
            del self._readers[path]
            self._newest.pop(path, None)
            self._emit(Unwatch(path))
