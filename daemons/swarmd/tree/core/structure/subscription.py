"""Subscriptions of this node's applications at other nodes, as sets of local patterns."""

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Final

import msgspec

from swarmd.tree.core.structure.index import Leaf, pattern
from swarmware.errors import InvalidInput
from swarmware.footprint.blake2b import blake2b
from swarmware.model.names import MAIN, Address, Pattern, split
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
    # sorted, so that equal sets have equal digests
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


@lru_cache(maxsize=512)
def _nodes(text: str) -> Pattern:
    """The pattern of names of platforms and computers. Raises: InvalidInput."""
    return Pattern(text, of_computers=True)


class LocalSubscriptions:
    """Patterns of this node's applications, by the platforms and computers that they name."""

    def __init__(
        self,
        own: Address,
        rules: Iterable[Rule],
        keep: Iterable[str] = (),
        holds: Callable[[str], bool] = lambda _path: False,
    ) -> None:
        """`keep`: local paths of every other platform to which the node always subscribes. `holds`: whether
        this computer provides a local path itself."""
        self._own = own
        self._rules = tuple(rules)
        self.keep = tuple(keep)
        self._holds = holds
        self._by_name: dict[str, frozenset[str]] = {}
        self._own_paths: frozenset[str] = frozenset()
        """Local paths of this platform that applications read here."""
        self.refused: dict[str, str] = {}
        """Invalid pattern of an application → the error."""

    def set_patterns(self, patterns: Iterable[str]) -> bool:
        """Set the patterns of all applications; returns True if they changed."""
        grouped: dict[str, set[str]] = {}
        own_paths = set()
        self.refused = {}
        for text in patterns:
            name, local = split(text)
            # its own resources are in the rings of this computer
            if name == self._own.path:
                continue
            local = local or ANYTHING
            try:
                pattern(local)
                if name is None or name == self._own.platform:
                    own_paths.add(local)
                    continue
                _nodes(name)
            except InvalidInput as error:
                self.refused[text] = str(error)
                continue
            grouped.setdefault(name, set()).add(local)
        before = self._by_name, self._own_paths
        self._by_name = {name: frozenset(locals_) for name, locals_ in grouped.items()}
        self._own_paths = frozenset(own_paths)
        return before != (self._by_name, self._own_paths)

    def of_platform(self, address: Address) -> frozenset[str]:
        """Patterns for the resources of its platform, whichever computer provides them."""
        if address.platform == self._own.platform:
            return frozenset(path for path in self._own_paths if not self._holds(path))
        return self._read_at(address.platform) | frozenset(self.keep)

    def _read_at(self, platform: str) -> frozenset[str]:
        """Patterns of this node's applications for the resources of another platform."""
        return self._matching(lambda text: _nodes(text).matches(platform))

    def of_computer(self, address: Address) -> frozenset[str]:
        """Patterns for the resources of exactly this computer."""
        if address.unit == MAIN:
            return self._by_name.get(address.path, frozenset())
        return self._matching(lambda text: _nodes(text).matches(address.path))

    def _matching(self, fits: Callable[[str], bool]) -> frozenset[str]:
        found = (locals_ for text, locals_ in self._by_name.items() if fits(text))
        return frozenset().union(*found)

    def of(self, address: Address) -> Subscription:
        """The subscription at one node."""
        if address.platform == self._own.platform:
            found = self.of_platform(address) | self.of_computer(address)
            return make_subscription(found, self._rules if found else ())
        found = self._read_at(address.platform) | self.of_computer(address)
        # where an application reads a path, its values come without the slow rule
        kept = [path for path in self.keep if not any(pattern(text).matches(path) for text in found)]
        found |= frozenset(kept)
        slow = tuple(Rule(path, min_interval_s=KEEP_S) for path in kept)
        return make_subscription(found, (*self._rules, *slow) if found else ())
