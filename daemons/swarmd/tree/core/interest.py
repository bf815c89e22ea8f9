"""What applications here want of other platforms, as sets of local patterns per platform."""

from collections.abc import Iterable, Mapping
from functools import lru_cache
from hashlib import blake2b
from typing import Final

import msgspec

from swarmd.tree.core.index import Leaf, pattern
from swarmware.errors import InvalidInput
from swarmware.names import split
from swarmware.resource import Kind
from swarmware.types.tree import Rule

_encoder = msgspec.msgpack.Encoder()

ANYTHING = "**"
KEEP_S: Final = 1.0
"""Between two values that are kept for the case that their platform is lost, and that nobody reads."""


class Wish(msgspec.Struct, frozen=True):
    """What one platform asks of another: the body of a subscription."""

    patterns: tuple[str, ...]
    rules: tuple[Rule, ...]
    digest: int
    """Of the two; both sides compare it instead of the body."""


@lru_cache(maxsize=1024)
def wish(patterns: frozenset[str], rules: tuple[Rule, ...]) -> Wish:
    """The wish for local patterns; equal content gives the same object."""
    ordered = tuple(sorted(patterns))
    mark = blake2b(_encoder.encode((ordered, rules)), digest_size=8).digest()
    return Wish(ordered, rules, int.from_bytes(mark, "little"))


NOTHING: Final = wish(frozenset(), ())
"""Asked of a platform, it takes a subscription back."""


def subscribable(item: Leaf, patterns: Iterable[str]) -> bool:
    """Whether one of the patterns asks for the values of this resource.

    Whatever travels only on request is given to those who name exactly its path.
    """
    resource = item.resource
    if resource.kind in {Kind.BRANCH, Kind.COMMAND, Kind.FILE}:
        return False
    path = resource.path
    if resource.link == "request":
        return path in patterns
    return any(pattern(text).matches(path) for text in patterns)


class Interests:
    """Patterns of this platform's applications, by the platforms they name."""

    def __init__(self, own: str, rules: Iterable[Rule], keep: Iterable[str] = ()) -> None:
        """`keep`: local paths of every other platform that are wanted also when no application reads them."""
        self._own = own
        self._rules = tuple(rules)
        self.keep = tuple(keep)
        self._by_platform: dict[str, frozenset[str]] = {}
        self.refused: dict[str, str] = {}
        """Text of an application that is no pattern → what is wrong with it."""

    def set_patterns(self, patterns: Iterable[str]) -> bool:
        """All patterns of all applications now; whether anything changed."""
        grouped: dict[str, set[str]] = {}
        self.refused = {}
        for text in patterns:
            platform, local = split(text)
            if platform is None or platform == self._own:
                continue
            local = local or ANYTHING
            try:
                pattern(platform)
                pattern(local)
            except InvalidInput as error:
                self.refused[text] = str(error)
                continue
            grouped.setdefault(platform, set()).add(local)
        now = {platform: frozenset(locals_) for platform, locals_ in grouped.items()}
        changed = now != self._by_platform
        self._by_platform = now
        return changed

    def of(self, platform: str) -> Wish:
        """What is wanted of one platform."""
        found: frozenset[str] = frozenset()
        for text, locals_ in self._by_platform.items():
            if text == platform or pattern(text).matches(platform):
                found |= locals_
        kept = [path for path in self.keep if not any(pattern(text).matches(path) for text in found)]
        found |= frozenset(kept)
        slow = tuple(Rule(path, min_interval_s=KEEP_S) for path in kept)
        return wish(found, (*self._rules, *slow) if found else ())

    def texts(self) -> Mapping[str, frozenset[str]]:
        """Platform pattern → local patterns."""
        return self._by_platform
