"""Paths as a tree of their segments, in which a pattern is searched without reading every path.

A copy shares all branches with its original until one of the two changes them: platforms of one template
have most of their branches in common.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Final, Generic, TypeVar

from swarmware.model.names import Pattern

_DEEP: Final = "**"
_MEMO_LIMIT: Final = 4096
"""Segments for which a search keeps the outcome, which come from outside."""

State = tuple[int, ...]
"""Numbers of the segments of a pattern that may match the next segment of a path, ascending."""

T = TypeVar("T")


class _Branch(Generic[T]):
    """The segments below one part of a path."""

    __slots__ = ("branches", "editor", "is_sorted", "leaves")

    def __init__(self, editor: object) -> None:
        self.branches: dict[str, _Branch[T]] = {}
        self.leaves: dict[str, T] = {}
        """Last segment → value of the path."""
        self.editor = editor
        """The trie that may change this branch in place; of others it is a copy that is changed."""
        self.is_sorted = True
        """Whether both are in the order of the paths, so that a search need not sort what it finds."""

    def copy(self, editor: object) -> "_Branch[T]":
        twin = _Branch[T](editor)
        twin.branches = self.branches.copy()
        twin.leaves = self.leaves.copy()
        twin.is_sorted = self.is_sorted
        return twin

    def sort(self) -> None:
        """Bring leaves and branches into the order of the paths: `/` is before all characters of names."""
        self.leaves = dict(sorted(self.leaves.items(), key=_name))
        self.branches = dict(sorted(self.branches.items(), key=_name))
        self.is_sorted = True


class PathTrie(Generic[T]):
    """Values by path, found in the order of the paths."""

    __slots__ = ("_editor", "_root")

    def __init__(self, items: Iterable[tuple[str, T]] = ()) -> None:
        """`items`: fastest in the order of their paths."""
        self._editor = object()
        self._root = _Branch[T](self._editor)
        for path, value in items:
            self.put(path, value)

    def copy(self) -> "PathTrie[T]":
        """A separate trie of the same paths and values."""
        twin = PathTrie[T]()
        twin._root = self._root
        self._editor = object()  # from now on the branches are of both
        return twin

    def put(self, path: str, value: T) -> None:
        """Add a path, or replace its value."""
        *above, last = path.split("/")
        branch = self._editable(above)[-1]
        if branch.is_sorted and last not in branch.leaves:
            branch.is_sorted = not branch.leaves or next(reversed(branch.leaves)) < last
        branch.leaves[last] = value

    def remove(self, path: str) -> None:
        """Remove a path that was added."""
        *above, last = path.split("/")
        branches = self._editable(above)
        del branches[-1].leaves[last]
        for parent, segment, branch in zip(branches[-2::-1], above[::-1], branches[:0:-1], strict=True):
            # an empty branch would be found by `**` and searched for nothing
            if branch.leaves or branch.branches:
                break
            del parent.branches[segment]

    def _editable(self, segments: list[str]) -> list[_Branch[T]]:
        """The root and the branches of these segments, which may be changed in place."""
        branch = self._root
        if branch.editor is not self._editor:
            branch = self._root = branch.copy(self._editor)
        found = [branch]
        for segment in segments:
            child = branch.branches.get(segment)
            if child is None:
                if branch.is_sorted and branch.branches:
                    branch.is_sorted = next(reversed(branch.branches)) < segment
                child = branch.branches[segment] = _Branch(self._editor)
            elif child.editor is not self._editor:
                child = branch.branches[segment] = child.copy(self._editor)
            branch = child
            found.append(branch)
        return found

    def find(self, text: str) -> list[T]:
        """The values of the paths that match a pattern, in the order of the paths.

        Raises: InvalidInput when it is not a pattern.
        """
        return _search(text).collect(self._root)


class _Step:
    """What a search does in one state: which segments it looks up, or which of all it takes."""

    __slots__ = (
        "accepts_all",
        "branches",
        "leaves",
        "literal_branches",
        "literal_leaves",
        "matchers",
        "names",
        "state",
    )

    def __init__(self, segments: tuple[str, ...], state: State) -> None:
        last = len(segments) - 1
        present = [number for number in state if number <= last]
        self.accepts_all = last in present and segments[last] == _DEEP
        is_deep = any(segments[number] == _DEEP for number in present)
        plain = [number for number in present if segments[number] != _DEEP]
        self.matchers: list[tuple[Callable[[str], bool], int]] = [
            (_matcher(segments[number]), number) for number in plain
        ]
        literals = {segments[number] for number in plain}
        ends = [number for number in plain if last + 1 in _closed(segments, number + 1)]
        self.leaves = [_matcher(segments[number]) for number in ends]
        end_literals = {segments[number] for number in ends}
        self.literal_leaves = None if any(map(_is_glob, end_literals)) else tuple(sorted(end_literals))
        """None: all leaves are checked."""
        every = is_deep or any(map(_is_glob, literals))
        self.literal_branches = None if every else tuple(sorted(literals))
        """None: all branches are checked."""
        self.state = state
        self.branches: dict[str, _Step | None] = {}
        """Step after a segment, as far as it was seen, or None if nothing below it matches."""
        self.names: dict[str, bool] = {}
        """Whether a path may end with a segment, as far as it was seen."""

    def is_end(self, name: str) -> bool:
        """Whether a path may end with a segment."""
        known = self.names.get(name)
        if known is None:
            if len(self.names) >= _MEMO_LIMIT:
                self.names.clear()
            known = self.names[name] = any(matches(name) for matches in self.leaves)
        return known

    def ends(self, leaves: dict[str, T]) -> dict[str, T]:
        """The leaves with which a path may end, in their order."""
        if self.accepts_all:
            return leaves
        if self.literal_leaves is None:
            return {name: value for name, value in leaves.items() if self.is_end(name)}
        return {name: leaves[name] for name in self.literal_leaves if name in leaves}


class _Search:
    """The search of one pattern; it keeps what it learned about segments."""

    def __init__(self, text: str) -> None:
        Pattern(text)
        self._segments = tuple(text.split("/"))
        self._steps: dict[State, _Step] = {}
        self._start = self._step(_closed(self._segments, 0))

    def collect(self, root: _Branch[T]) -> list[T]:
        """The values of the matching paths below a branch, in the order of the paths."""
        found: list[T] = []
        self._collect(root, self._start, found)
        return found

    def _collect(self, branch: _Branch[T], step: "_Step", found: list[T]) -> None:
        """Most branches have either leaves or branches: those are read without another call."""
        if not branch.is_sorted:
            branch.sort()
        if step.accepts_all and not branch.leaves:
            for below in branch.branches.values():
                if below.branches or not below.is_sorted:
                    self._collect(below, step, found)
                else:
                    found += below.leaves.values()
            return
        leaves = step.ends(branch.leaves) if branch.leaves else {}
        names, at, after = list(leaves), 0, step.branches
        branches = branch.branches
        for name in branches if step.literal_branches is None else step.literal_branches:
            if (child := branches.get(name)) is None:
                continue
            # names repeat in every platform, so the step after a name is computed once
            following = after[name] if name in after else self._after(step, name)
            if following is None:
                continue
            if names:  # `a` is before `a/c`, and that before `ab`
                end = bisect_right(names, name, at)
                found += [leaves[one] for one in names[at:end]]
                at = end
            if child.branches or not child.is_sorted:
                self._collect(child, following, found)
            elif following.accepts_all:
                found += child.leaves.values()
            elif following.literal_leaves is None:
                is_end = following.is_end
                found += [value for one, value in child.leaves.items() if is_end(one)]
            else:
                ends = child.leaves
                for one in following.literal_leaves:
                    if one in ends:
                        found.append(ends[one])
        found += [leaves[one] for one in names[at:]] if at else leaves.values()

    def _step(self, state: State) -> _Step:
        known = self._steps.get(state)
        if known is None:
            known = self._steps[state] = _Step(self._segments, state)
        return known

    def _after(self, step: _Step, name: str) -> _Step | None:
        """The step below a segment, or None if nothing below it matches."""
        if len(step.branches) >= _MEMO_LIMIT:
            step.branches.clear()
        segments = self._segments
        reached = {number for number in step.state if number < len(segments) and segments[number] == _DEEP}
        reached |= {number + 1 for matches, number in step.matchers if matches(name)}
        state = tuple(sorted({number for one in reached for number in _closed(segments, one)}))
        following = step.branches[name] = self._step(state) if state else None
        return following


@lru_cache(maxsize=256)
def _search(text: str) -> _Search:
    return _Search(text)


def _closed(segments: tuple[str, ...], number: int) -> State:
    """The state at a segment of the pattern: `**` may also match nothing."""
    found = [number]
    while number < len(segments) and segments[number] == _DEEP:
        number += 1
        found.append(number)
    return tuple(found)


def _is_glob(segment: str) -> bool:
    return "*" in segment or "{" in segment


def _matcher(segment: str) -> Callable[[str], bool]:
    if not _is_glob(segment):
        return segment.__eq__
    if not segment.strip("*"):
        return bool  # any segment
    return Pattern(segment).matches


def _name(item: tuple[str, object]) -> str:
    return item[0]
