"""Paths by their segments: finds the few paths that a pattern with leading wildcards can match."""

from collections.abc import Collection, Iterable
from functools import lru_cache
from itertools import chain

from swarmware.model.names import Pattern


class SegmentIndex:
    """Segment → paths that contain it."""

    __slots__ = ("_paths",)

    def __init__(self, paths: Iterable[str]) -> None:
        self._paths: dict[str, set[str]] = {}
        for path in paths:
            self.add(path)

    def add(self, path: str) -> None:
        """Add a path by its segments."""
        for segment in path.split("/"):
            known = self._paths.get(segment)
            if known is None:
                self._paths[segment] = {path}
            else:
                known.add(path)

    def remove(self, path: str) -> None:
        """Remove a path that was added."""
        for segment in set(path.split("/")):
            known = self._paths[segment]
            known.remove(path)
            if not known:
                del self._paths[segment]

    def candidates(self, text: str) -> Collection[str] | None:
        """The paths among which all matches of a pattern are: those of its rarest segment.

        None: each of its segments matches any.
        """
        best: list[set[str]] | None = None
        smallest = 0
        for segment in _narrowing(text):
            found = self._matching(segment)
            size = sum(map(len, found))
            if best is None or size < smallest:
                best, smallest = found, size
        if best is None:
            return None
        return best[0] if len(best) == 1 else set(chain.from_iterable(best))

    def _matching(self, segment: Pattern) -> list[set[str]]:
        if segment.literal:
            known = self._paths.get(segment.text)
            return [] if known is None else [known]
        return [paths for known, paths in self._paths.items() if segment.matches(known)]


@lru_cache(maxsize=512)
def _narrowing(text: str) -> tuple[Pattern, ...]:
    """The segments of a pattern that do not match any segment."""
    return tuple(Pattern(segment) for segment in text.split("/") if segment.strip("*"))
