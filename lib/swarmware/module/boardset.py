"""The same board of many platforms, as a mapping that grows with their mirrors."""

import os
from collections.abc import Callable, Iterator, Mapping
from typing import Generic, TypeVar

import msgspec

from swarmware.errors import InvalidInput, NoAnswer
from swarmware.model import paths
from swarmware.model.names import Pattern, check_path
from swarmware.module.board import BoardReader
from swarmware.module.wakeup import Deadline, Wakeup
from swarmware.node.node import Node
from swarmware.transport.shm.layout import ring_file

T = TypeVar("T", bound=msgspec.Struct)


class BoardSet(Mapping[str, BoardReader[T]], Generic[T]):
    """Mapping of platform to reader, for every other platform with a mirror of the board on this node.

    A pattern with a point is of computers: `/*.*/register/apps`, each unit that is not `main`.
    """

    def __init__(self, node: Node, pattern: str, open_reader: Callable[[str], BoardReader[T]]) -> None:
        platforms, _, local = pattern.removeprefix("/").partition("/")
        if not pattern.startswith("/") or not Pattern(local).literal:
            raise InvalidInput(f"pattern {pattern!r}: expected wildcards only in the platform: /*/nav/pose")
        self.pattern = pattern
        self._local = check_path(local)
        self._platforms = Pattern(platforms, of_computers=True)
        self._node = node
        self._open = open_reader
        self._readers: dict[str, BoardReader[T]] = {}
        self._folder = str(node.shm_dir)
        self._folder_ns = -1
        self._ring_changes = -1
        self._listening = False
        self._wakeup = Wakeup()
        self._given: dict[str, int] = {}

    def _refresh(self) -> None:
        try:
            folder_ns = os.stat(self._folder).st_mtime_ns  # noqa: PTH116  # at every bell: no Path object
        except FileNotFoundError:
            return
        if folder_ns == self._folder_ns:
            return
        self._folder_ns = folder_ns
        # only when the folder has changed: a walk at each access would cost more than the reading
        for folder in self._node.shm_dir.iterdir():
            name = folder.name
            # mirrors of the own platform come from its other computers, which are not other platforms
            own = name in {self._node.platform, self._node.address.path}
            if name in self._readers or own or not self._platforms.matches(name):
                continue
            if ring_file(self._node.shm_dir, self._local, name).exists():
                self._readers[name] = self._open(f"/{name}/{self._local}")

    def __getitem__(self, platform: str) -> BoardReader[T]:
        if platform not in self._readers:
            self._refresh()
        return self._readers[platform]

    def __iter__(self) -> Iterator[str]:
        self._refresh()
        return iter(tuple(self._readers))

    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return id(self)

    def __len__(self) -> int:
        self._refresh()
        return len(self._readers)

    def poll(self) -> None:
        """The doorbell has rung: wake the waiting tasks if a board has changed."""
        # without a waiting task the boards are read later anyway
        if self._wakeup.awaited and self._has_news():
            self._wakeup.notify()

    def _has_news(self) -> bool:
        if self._ring_changes != self._node.ring_changes:
            self._ring_changes = self._node.ring_changes
            self._refresh()
        given = self._given
        return any(reader.position != given.get(platform, -1) for platform, reader in self._readers.items())

    async def changed(self, timeout_s: float | None = None) -> tuple[str, ...]:
        """Platforms with a value that was not reported yet, see `news`; waits for the first.

        Raises: NoAnswer when none arrives within the time-out.
        """
        deadline = Deadline(timeout_s)
        if not self._listening:
            self._listening = True
            self._node.listen(paths.mirrors_watchers(self._node.shm_dir))
            self._node.watch(self)
            for platform in self._given:
                self._readers[platform].ring_only()
        while True:
            if fresh := self.news():
                return fresh
            if not await self._wakeup.until(deadline):
                raise NoAnswer(f"boards {self.pattern}: no new value within {timeout_s} s")

    def news(self) -> tuple[str, ...]:
        """Platforms with a value that neither this method nor `changed` has reported yet."""
        fresh = []
        self._refresh()
        for platform, reader in self._readers.items():
            if platform not in self._given:
                # -1, so that a value that the mirror has already is news, too.
                self._given[platform] = -1
                if self._listening:
                    reader.ring_only()
            if (at := reader.position) != self._given[platform]:
                self._given[platform] = at  # any later write is a change
                if reader.value is not None:
                    fresh.append(platform)
        return tuple(fresh)

    def close(self) -> None:
        """Stop reading and close all rings."""
        if self._listening:
            self._listening = False
            self._node.unwatch(self)
            self._node.unlisten(paths.mirrors_watchers(self._node.shm_dir))
        for reader in self._readers.values():
            reader.close()
        self._readers.clear()
