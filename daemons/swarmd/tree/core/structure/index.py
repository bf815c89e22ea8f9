"""The index of one platform's resources: sorted by path, with a digest that follows every change."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Final

import msgspec

from swarmd.tree.core.structure.path_trie import PathTrie
from swarmware.footprint.blake2b import blake2b
from swarmware.model.names import Pattern, similar
from swarmware.model.resource import Resource

_encoder = msgspec.msgpack.Encoder()
HINTS: Final = 3


class Leaf(msgspec.Struct, frozen=True, gc=False):
    """A resource, and whether its owner is lost."""

    resource: Resource
    lost: bool
    """True if the owner ran and has ended."""
    mark: int
    """64-bit hash of the two: the digest of an index is the exclusive or of its marks."""


def leaf(resource: Resource, *, lost: bool = False) -> Leaf:
    """The leaf of a descriptor."""
    mark = blake2b(_encoder.encode((resource, lost)), digest_size=8).digest()
    return Leaf(resource, lost, int.from_bytes(mark, "little"))


@lru_cache(maxsize=512)
def pattern(text: str) -> Pattern:
    """The compiled pattern. Raises: InvalidInput."""
    return Pattern(text)


class Index:
    """Path → leaf; patterns are found by the segments of the paths."""

    __slots__ = ("_leaves", "_paths", "digest")

    def __init__(self, leaves: Iterable[Leaf] = ()) -> None:
        self._leaves = {item.resource.path: item for item in leaves}
        self._paths = PathTrie(sorted(self._leaves.items()))
        self.digest = 0
        """Equal for equal content, independent of the order of changes."""
        for item in self._leaves.values():
            self.digest ^= item.mark

    def copy(self) -> "Index":
        """A separate index with the same leaves."""
        twin = Index()
        twin._leaves = self._leaves.copy()
        twin._paths = self._paths.copy()
        twin.digest = self.digest
        return twin

    def put(self, item: Leaf) -> bool:
        """Add or replace a leaf; returns whether anything changed."""
        path = item.resource.path
        old = self._leaves.get(path)
        if old is not None:
            if old.mark == item.mark:
                return False
            self.digest ^= old.mark
        self._paths.put(path, item)
        self._leaves[path] = item
        self.digest ^= item.mark
        return True

    def remove(self, path: str) -> bool:
        """Remove the leaf at a path; returns whether there was one."""
        old = self._leaves.pop(path, None)
        if old is None:
            return False
        self.digest ^= old.mark
        self._paths.remove(path)
        return True

    def get(self, path: str) -> Leaf | None:
        """The leaf at a path."""
        return self._leaves.get(path)

    def __len__(self) -> int:
        return len(self._leaves)

    def __contains__(self, path: str) -> bool:
        return path in self._leaves

    def __iter__(self) -> Iterator[Leaf]:
        """Iterate over all leaves, in no particular order."""
        return iter(self._leaves.values())

    def match(self, text: str, *, after: str = "") -> list[Leaf]:
        """Leaves whose path matches, sorted by path; only those behind `after`.

        Raises: InvalidInput if the text is not a pattern.
        """
        if pattern(text).literal:
            found = self._leaves.get(text)
            return [found] if found is not None and text > after else []
        leaves = self._paths.find(text)
        return leaves[bisect_right(leaves, after, key=_path) :] if after else leaves

    def near(self, path: str) -> list[str]:
        """Paths similar to this one, best match first."""
        branch = path.rpartition("/")[0]
        below = map(_path, self._paths.find(f"{branch}/**")) if branch else ()
        siblings = [one for one in below if one != branch]
        # bounded: each path costs a comparison, and a mistyped path must be answered quickly
        paths = sorted(self._leaves)[:5000]
        close = similar(path, siblings or paths, limit=HINTS, cutoff=0.6)
        if not close and siblings:
            close = similar(path, paths, limit=HINTS, cutoff=0.6) or siblings[:HINTS]
        return close


def _path(item: Leaf) -> str:
    return item.resource.path
