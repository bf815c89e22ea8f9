"""Decision which application serves an address that several claim."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from swarmware.model.paths import is_reserved_path
from swarmware.transport.appfile.entry import AppEntry, Served
from swarmware.transport.shm.access import user_name

NAMED: Final = 3
"""Paths that a line names."""


class LivingApplication(NamedTuple):
    """A living application, and the user who runs it by the owner of its file."""

    entry: AppEntry
    uid: int
    is_own: bool
    """True if that user is the node's or root."""

    @property
    def user(self) -> str:
        """Name of the user, for messages."""
        return user_name(self.uid)


class AddressClaims:
    """The applications of a node, and who of them serves each address.

    Paths of the daemons are served by the node's user only. At every other path an application of that
    user precedes other users' applications; then the former claim precedes, then the older one.
    """

    def __init__(
        self, applications: Sequence[LivingApplication] = (), former: "AddressClaims | None" = None
    ) -> None:
        self._by_id: dict[int, LivingApplication] = {}
        for one in applications:
            # The id is a hash of name and instance, so that two names can have the same one.
            held = self._by_id.get(one.entry.app_id)
            if held is None or (one.is_own and not held.is_own):  # two names with one id
                self._by_id[one.entry.app_id] = one
        self.of_node = [one.entry for one in self._by_id.values() if one.is_own]
        """Applications of the node's own user, and of root."""
        self.entries = self.of_node + [one.entry for one in self._by_id.values() if not one.is_own]
        """All applications; the node's own user's come first."""
        self.refused: tuple[str, ...] = ()
        """Claims that do not count, a line for each application and each contested path."""
        self._by_path: dict[str, tuple[LivingApplication, Served]] = {}
        for one in self._by_id.values():
            reserved = [item.path for item in one.entry.serves if is_reserved_path(item.path)]
            if reserved and not one.is_own:
                self.refused += (
                    f"{one.entry.id} of {one.user} claims {_shown(reserved)}:"
                    " served by the user of the node alone",
                )
            for item in one.entry.serves:
                if one.is_own or item.path not in reserved:
                    self._claim(one, item, former)
        self._by_data_id: dict[int, tuple[AppEntry, Served]] = {}
        for one, item in sorted(self._by_path.values(), key=_foreign_first):
            self._by_data_id[item.data_id] = (one.entry, item)
        self.endpoints = {entry.app_id: entry.endpoint for entry in self.entries}
        self.serving_endpoints = {data_id: entry.endpoint for data_id, (entry, _) in self._by_data_id.items()}

    def _claim(self, one: LivingApplication, item: Served, former: "AddressClaims | None") -> None:
        path = item.path
        held = self._by_path.get(path)
        if held is None:
            self._by_path[path] = (one, item)
            return
        standing = None if former is None else former.of_path(path)
        first, second = sorted((held[0], one), key=lambda each: _order(each, standing))
        self.refused += (
            f"{second.entry.id} of {second.user} claims {path}: served by {first.entry.id} already",
        )
        if first is one:
            self._by_path[path] = (one, item)

    def of_path(self, path: str) -> tuple[AppEntry, Served] | None:
        """The application that serves this local path, and what it serves there."""
        found = self._by_path.get(path)
        return None if found is None else (found[0].entry, found[1])

    def of_data_id(self, data_id: int) -> tuple[AppEntry, Served] | None:
        """The application that serves this data id, and what it serves there."""
        return self._by_data_id.get(data_id)

    def application(self, app_id: int) -> AppEntry | None:
        """The application of this id."""
        found = self._by_id.get(app_id)
        return None if found is None else found.entry


def _shown(found: list[str]) -> str:
    more = len(found) - NAMED
    return ", ".join(found[:NAMED]) + (f" and {more} more" if more > 0 else "")


def _order(one: LivingApplication, standing: tuple[AppEntry, Served] | None) -> tuple[bool, bool, int]:
    """Order of two claims: what an application states of its start counts last, as it may be false."""
    entry = one.entry
    is_known = standing is not None and (
        (standing[0].id, standing[0].pid, standing[0].pid_start) == (entry.id, entry.pid, entry.pid_start)
    )
    return not one.is_own, not is_known, entry.started_ns


def _foreign_first(claim: tuple[LivingApplication, Served]) -> bool:
    return claim[0].is_own
