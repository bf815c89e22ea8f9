"""Subscriptions of this platform's applications at other platforms, as sets of local patterns."""

from collections.abc import Iterable
from functools import lru_cache
from typing import Final

import msgspec

from swarmd.tree.core.structure.index import Leaf, pattern
from swarmware.errors import InvalidInput
from swarmware.model.digest import blake2b
from swarmware.model.names import split
from swarmware.model.resource import Kind
from swarmware.types.tree import Rule

_encoder = msgspec.msgpack.Encoder()

ANYTHING = "**"
KEEP_S: Final = 1.0
"""Interval of values that no application reads, kept for the loss of their platform."""


class Subscription(msgspec.Struct, frozen=True):
    """Body of a subscription of one platform at another."""

    patterns: tuple[str, ...]
    rules: tuple[Rule, ...]
    digest: int
    """Digest of patterns and rules, which both sides compare instead of the body."""


@lru_cache(maxsize=1024)
def make_subscription(patterns: frozenset[str], rules: tuple[Rule, ...]) -> Subscription:
    """The subscription for local patterns; equal content gives the same object."""
    ordered = tuple(sorted(patterns))
    mark = blake2b(_encoder.encode((ordered, rules)), digest_size=8).digest()
    return Subscription(ordered, rules, int.from_bytes(mark, "little"))


NO_SUBSCRIPTION: Final = make_subscription(frozenset(), ())
"""Sent to a platform, it ends the subscription there."""


def subscribable(item: Leaf, patterns: Iterable[str]) -> bool:
    """Whether one of the patterns subscribes to the values of this resource.

    A resource with the link `request` is sent only to a subscriber that names its exact path.
    """
    resource = item.resource
    if resource.kind in {Kind.BRANCH, Kind.COMMAND, Kind.FILE}:
        return False
    path = resource.path
    if resource.link == "request":
        return path in patterns
    return any(pattern(text).matches(path) for text in patterns)


class LocalSubscriptions:
    """Patterns of this platform's applications, by the platforms they name."""

    def __init__(self, own: str, rules: Iterable[Rule], keep: Iterable[str] = ()) -> None:
        """`keep`: local paths of every other platform to which the node always subscribes."""
        self._own = own
        self._rules = tuple(rules)
        self.keep = tuple(keep)
        self._by_platform: dict[str, frozenset[str]] = {}
        self.refused: dict[str, str] = {}
        """Invalid pattern of an application → the error."""

    def set_patterns(self, patterns: Iterable[str]) -> bool:
        """Set the patterns of all applications; whether they changed."""
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

    def of(self, platform: str) -> Subscription:
        """The subscription at one platform."""
        found: frozenset[str] = frozenset()
        for text, locals_ in self._by_platform.items():
            if text == platform or pattern(text).matches(platform):
                found |= locals_
        kept = [path for path in self.keep if not any(pattern(text).matches(path) for text in found)]
        found |= frozenset(kept)
        slow = tuple(Rule(path, min_interval_s=KEEP_S) for path in kept)
        return make_subscription(found, (*self._rules, *slow) if found else ())
