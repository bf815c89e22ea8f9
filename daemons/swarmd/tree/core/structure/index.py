"""The index of one platform's resources: sorted by path, with a digest that follows every change."""

from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Final

import msgspec
from sortedcontainers import SortedList

from swarmd.tree.core.structure.segments import SegmentIndex
from swarmware.model.digest import blake2b
from swarmware.model.names import Pattern
from swarmware.model.resource import Resource
from swarmware.model.similar import similar

_encoder = msgspec.msgpack.Encoder()
_AFTER: Final = chr(ord("/") + 1)
"""Sorts behind everything that begins with a path and a slash."""
HINTS: Final = 3


class Leaf(msgspec.Struct, frozen=True, gc=False):
    """A resource, and whether its owner is lost."""

    resource: Resource
    lost: bool
    """Its owner ran and has ended."""
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


SCAN_LIMIT: Final = 64
"""Up to this number of paths a search checks each one."""


class Index:
    """Path → leaf; patterns are found by a range search of their prefix, else by their rarest segment."""

    __slots__ = ("_leaves", "_paths", "_segments", "digest")

    def __init__(self, leaves: Iterable[Leaf] = ()) -> None:
        self._leaves = {item.resource.path: item for item in leaves}
        self._paths: SortedList[str] | None = None
        self._segments: SegmentIndex | None = None
        # both are built by the first search that needs them: most replicas are never searched
        self.digest = 0
        """Equal for equal content, independent of the order of changes."""
        for item in self._leaves.values():
            self.digest ^= item.mark

    def copy(self) -> "Index":
        """A separate index with the same leaves."""
        twin = Index()
        twin._leaves = self._leaves.copy()
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
        else:
            if self._paths is not None:
                self._paths.add(path)
            if self._segments is not None:
                self._segments.add(path)
        self._leaves[path] = item
        self.digest ^= item.mark
        return True

    def remove(self, path: str) -> bool:
        """Remove the leaf at a path; returns whether there was one."""
        old = self._leaves.pop(path, None)
        if old is None:
            return False
        self.digest ^= old.mark
        if self._paths is not None:
            self._paths.remove(path)
        if self._segments is not None:
            self._segments.remove(path)
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

    @property
    def paths(self) -> "SortedList[str]":
        """All paths of the index, sorted."""
        if self._paths is None:
            self._paths = SortedList(self._leaves)
        return self._paths

    def match(self, text: str, *, after: str = "") -> Iterator[Leaf]:
        """Leaves whose path matches, sorted by path; only those behind `after`.

        Raises: InvalidInput if the text is not a pattern.
        """
        wanted = pattern(text)
        if wanted.literal:
            found = self._leaves.get(text)
            if found is not None and text > after:
                yield found
            return
        # "a/**" matches "a" too, which stands before the prefix "a/"
        root = wanted.prefix.rstrip("/")
        if root > after and (found := self._leaves.get(root)) is not None and wanted.matches(root):
            yield found
        for path in self._below(root, max(wanted.prefix, after), after, text):
            if path != root:
                yield self._leaves[path]

    def _below(self, root: str, low: str, after: str, text: str) -> Iterable[str]:
        """Paths from `low` on that match, sorted; below a root, if there is one."""
        wanted = pattern(text)
        high = root + _AFTER if root else None
        whole = text == f"{wanted.prefix}**"  # every path of the range matches
        if not whole and self._is_long(low, high):
            if self._segments is None:
                self._segments = SegmentIndex(self._leaves)
            candidates = self._segments.candidates(text)
            if candidates is not None:
                return sorted(path for path in _among(candidates, text, wanted) if path > after)
        found = self.paths.irange(low, high, inclusive=(low != after, False))
        return found if whole else filter(wanted.matches, found)

    def _is_long(self, low: str, high: str | None) -> bool:
        """Whether a range has too many paths to check each one."""
        if len(self._leaves) <= SCAN_LIMIT or high is None:
            return len(self._leaves) > SCAN_LIMIT
        return bool(self.paths.bisect_left(high) - self.paths.bisect_left(low) > SCAN_LIMIT)

    def near(self, path: str) -> list[str]:
        """Paths similar to this one, best match first."""
        paths = self.paths
        branch = path.rpartition("/")[0]
        siblings = list(paths.irange(branch + "/", branch + _AFTER)) if branch else []
        close = similar(path, siblings or paths[:5000], limit=HINTS, cutoff=0.6)
        if not close and siblings:
            close = similar(path, paths[:5000], limit=HINTS, cutoff=0.6) or siblings[:HINTS]
        return close


def _among(candidates: Iterable[str], text: str, wanted: Pattern) -> Iterable[str]:
    """Those of the candidates that match."""
    last = text.removeprefix("**/")
    if last == text or any(char in last for char in "*{/"):
        return filter(wanted.matches, candidates)
    # `**/pose`: the most frequent of these patterns, in a third of the time of its expression
    end = f"/{last}"
    return (path for path in candidates if path.endswith(end) or path == last)
