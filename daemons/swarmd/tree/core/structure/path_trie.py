"""Paths as a tree of their segments, in which a pattern is searched without reading every path.

A copy shares all branches with its original until one of the two changes them: platforms of one template
have most of their branches in common.
"""

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Final

from swarmware.model.names import Pattern

_DEEP: Final = "**"
_MEMO_LIMIT: Final = 4096
"""Segments for which a search keeps the outcome, which come from outside."""

State = tuple[int, ...]
"""Numbers of the segments of a pattern that may match the next segment of a path, ascending."""


class _Branch:
    """The segments below one part of a path."""

    __slots__ = ("branches", "editor", "leaves")

    def __init__(self, editor: object) -> None:
        self.branches: dict[str, _Branch] = {}
        self.leaves: dict[str, str] = {}
        """Last segment → path."""
        self.editor = editor
        """The trie that may change this branch in place; of others it is a copy that is changed."""

    def copy(self, editor: object) -> "_Branch":
        twin = _Branch(editor)
        twin.branches = self.branches.copy()
        twin.leaves = self.leaves.copy()
        return twin


class PathTrie:
    """A set of paths."""

    __slots__ = ("_editor", "_root")

    def __init__(self, paths: Iterable[str] = ()) -> None:
        self._editor = object()
        self._root = _Branch(self._editor)
        for path in paths:
            self.add(path)

    def copy(self) -> "PathTrie":
        """A separate set of the same paths."""
        twin = PathTrie()
        twin._root = self._root
        self._editor = object()  # from now on the branches are of both
        return twin

    def add(self, path: str) -> None:
        """Add a path to the set."""
        *above, last = path.split("/")
        self._editable(above)[-1].leaves[last] = path

    def remove(self, path: str) -> None:
        """Remove a path that was added."""
        *above, last = path.split("/")
        branches = self._editable(above)
        del branches[-1].leaves[last]
        for parent, segment, branch in zip(branches[-2::-1], above[::-1], branches[:0:-1], strict=True):
            if branch.leaves or branch.branches:
                break
            del parent.branches[segment]

    def _editable(self, segments: list[str]) -> list[_Branch]:
        """The root and the branches of these segments, which may be changed in place."""
        branch = self._root
        if branch.editor is not self._editor:
            branch = self._root = branch.copy(self._editor)
        found = [branch]
        for segment in segments:
            child = branch.branches.get(segment)
            if child is None:
                child = branch.branches[segment] = _Branch(self._editor)
            elif child.editor is not self._editor:
                child = branch.branches[segment] = child.copy(self._editor)
            branch = child
            found.append(branch)
        return found

    def find(self, text: str) -> list[str]:
        """The paths that match a pattern, sorted. Raises: InvalidInput when it is not a pattern."""
        found = _search(text).collect(self._root)
        found.sort()
        return found


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
        self.literal_leaves = None if any(map(_is_glob, end_literals)) else tuple(end_literals)
        """None: all leaves are checked."""
        every = is_deep or any(map(_is_glob, literals))
        self.literal_branches = None if every else tuple(literals)
        """None: all branches are checked."""
        self.state = state
        self.branches: dict[str, _Step | None] = {}
        """Step after a segment, as far as it was seen; None: nothing below it matches."""
        self.names: dict[str, bool] = {}
        """Whether a path may end with a segment, as far as it was seen."""


class _Search:
    """The search of one pattern; it keeps what it learned about segments."""

    def __init__(self, text: str) -> None:
        Pattern(text)
        self._segments = tuple(text.split("/"))
        self._steps: dict[State, _Step] = {}
        self._start = self._step(_closed(self._segments, 0))

    def collect(self, root: _Branch) -> list[str]:
        """The matching paths below a branch, in no particular order."""
        found: list[str] = []
        left = [(root, self._start)]
        while left:
            branch, step = left.pop()
            if step.accepts_all:
                _all_below(branch, found)
                continue
            leaves, branches, after = branch.leaves, branch.branches, step.branches
            if step.literal_leaves is None:
                found += [path for name, path in leaves.items() if _is_end(step, name)]
            else:
                for name in step.literal_leaves:
                    if name in leaves:
                        found.append(leaves[name])
            if step.literal_branches is None:
                for name, child in branches.items():
                    following = after[name] if name in after else self._after(step, name)
                    if following is not None:
                        left.append((child, following))
            else:
                for name in step.literal_branches:
                    if name in branches:
                        following = after[name] if name in after else self._after(step, name)
                        if following is not None:
                            left.append((branches[name], following))
        return found

    def _step(self, state: State) -> _Step:
        known = self._steps.get(state)
        if known is None:
            known = self._steps[state] = _Step(self._segments, state)
        return known

    def _after(self, step: _Step, name: str) -> _Step | None:
        """The step below a segment; None: nothing below it matches."""
        if len(step.branches) >= _MEMO_LIMIT:
            step.branches.clear()
        segments = self._segments
        reached = {number for number in step.state if number < len(segments) and segments[number] == _DEEP}
        reached |= {number + 1 for matches, number in step.matchers if matches(name)}
        state = tuple(sorted({number for one in reached for number in _closed(segments, one)}))
        following = step.branches[name] = self._step(state) if state else None
        return following


def _is_end(step: _Step, name: str) -> bool:
    known = step.names.get(name)
    if known is None:
        if len(step.names) >= _MEMO_LIMIT:
            step.names.clear()
        known = step.names[name] = any(matches(name) for matches in step.leaves)
    return known


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


def _all_below(branch: _Branch, found: list[str]) -> None:
    found += branch.leaves.values()
    for child in branch.branches.values():
        _all_below(child, found)
