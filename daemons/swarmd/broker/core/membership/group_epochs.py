"""The group key that seals own datagrams, and the keys that open received ones, during a rotation."""

from typing import Final

from swarmware.transport.security.seal import GroupKey

SWITCH_NS: Final = 2_000_000_000
"""Time after which a new key is used, also when a neighbour has not shown that it has it."""
ACCEPT_NS: Final = 10_000_000_000
"""Time for which the datagrams of the former key are accepted."""


class GroupEpochs:
    """The group keys in use: one seals, one or more open."""

    def __init__(self, group: GroupKey) -> None:
        self.sealing = group
        self._newest = group
        self._switch_ns = 0
        self._former: dict[int, tuple[GroupKey, int]] = {}
        """Former keys by mark, and until when they open."""

    def rotate(self, group: GroupKey, now_ns: int) -> None:
        """Takes a new key, which opens at once, and seals when the neighbours have it."""
        if not self.is_switching:
            self._switch_ns = now_ns + SWITCH_NS
        self._former[self._newest.mark] = self._newest, now_ns + ACCEPT_NS
        self._former.pop(group.mark, None)
        self._newest = group

    @property
    def is_switching(self) -> bool:
        """Whether the newest key does not seal yet."""
        return self.sealing is not self._newest

    def switch(self, all_have_it: bool, now_ns: int) -> bool:
        """Seal with the newest key if it is time; returns True if the key changed."""
        if not self.is_switching or not (all_have_it or now_ns >= self._switch_ns):
            return False
        self.sealing = self._newest
        return True

    def opening(self, mark: int, now_ns: int) -> GroupKey | None:
        """The key that opens datagrams with this mark now, or None if no key with it is accepted."""
        if mark == self._newest.mark:
            return self._newest
        former = self._former.get(mark)
        if former is None:
            return None
        if now_ns >= former[1] and former[0] is not self.sealing:
            del self._former[mark]
            return None
        return former[0]
