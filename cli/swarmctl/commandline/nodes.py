"""Selection of nodes: names and patterns of platforms, as `-n` and the arguments of commands accept them."""

from collections.abc import Collection, Iterable, Iterator
from typing import Final

from swarmware.errors import InvalidInput, NotFound
from swarmware.model import names
from swarmware.model.names import Pattern

EVERY: Final = "*"
"""Selection of all nodes, as `--all` makes it."""
_SPECIAL: Final = frozenset("*{},")


def names_one(text: str) -> bool:
    """Whether a selection is a single name, neither "" nor a pattern."""
    return bool(text) and not _SPECIAL.intersection(text)


def is_selection(text: str) -> bool:
    """Whether a selection may name several nodes."""
    return bool(text) and not names_one(text)


class NodeSelection:
    """Nodes by the text between the braces of a path pattern: `uav1`, `uav*`, `uav{1,3}`, `uav1,gcs`.

    Raises: InvalidInput for a malformed selection.
    """

    __slots__ = ("_words", "pattern")

    def __init__(self, text: str) -> None:
        self._words = list(_words(text))
        for word in self._words:
            if not word or "/" in word:
                raise InvalidInput(
                    f"nodes {text!r}: {word!r}: expected names or patterns of platforms, such as uav1,'ugv*'"
                )
            if names_one(word):
                self._check_name(word)  # as a pattern, an invalid name would match nothing without an error
            else:
                Pattern(word)  # the message quotes the part that is wrong
        # the segment of a path pattern that matches these platforms
        self.pattern = text if names_one(text) or text == EVERY else f"{{{text}}}"
        Pattern(self.pattern, of_computers=True)

    def _check_name(self, word: str) -> None:
        """Check a platform, or one computer of it that is selected alone: `uav1.fc`. Raises: InvalidInput."""
        if len(self._words) == 1:
            names.check_computer(word)
        else:
            names.check_platform(word)

    def matches(self, platform: str) -> bool:
        """Whether a platform is selected."""
        return Pattern(self.pattern, of_computers=True).matches(platform)

    def has_name(self, platform: str) -> bool:
        """Whether a platform is selected by its name, not only by a pattern."""
        return platform in self._words

    def choose(self, known: Collection[str], here: str) -> list[str]:
        """Known platforms that are selected, in natural order.

        Raises: NotFound naming the known ones when a name or a pattern matches none.
        """
        there = ", ".join(sorted(known, key=names.natural)) or "none"
        chosen: set[str] = set()
        for word in self._words:
            matcher = Pattern(word)
            found = {name for name in known if matcher.matches(name)}
            if not found:
                what = f"node {word!r}: not known" if names_one(word) else f"nodes {word!r}: no node matches"
                raise NotFound(f"{what}; known to {here}: {there}")
            chosen |= found
        return sorted(chosen, key=names.natural)


def _words(text: str) -> Iterator[str]:
    """Parts of a selection between the commas outside braces."""
    depth, begin = 0, 0
    for at, char in enumerate(text):
        depth += (char == "{") - (char == "}")
        if char == "," and depth == 0:
            yield text[begin:at]
            begin = at + 1
    yield text[begin:]


def joined(words: Iterable[str]) -> str:
    """One selection of several names and patterns."""
    return ",".join(words)
