"""Finds resources of this computer whose number in frames another path has, here or elsewhere."""

from collections.abc import Iterable

from swarmd.tree.core.replicas.replica import Replica
from swarmd.tree.core.structure.local import LocalTree
from swarmware.model.names import join
from swarmware.model.resource import Kind, Resource, clash_text


class NumberWatch:
    """Compares structures that have changed since the last call.

    Orders carry a number, no path: an order for a path of another computer would reach a resource here.
    """

    def __init__(self, own: LocalTree, replicas: Iterable[Replica]) -> None:
        self._own = own
        self._replicas = replicas
        self._own_digest: int | None = None
        self._numbers: dict[int, Resource] = {}
        self._found: dict[str, tuple[int, list[str]]] = {}
        """Digest of the structure of each computer, and the clashes with it."""

    def texts(self) -> list[str]:
        """The clashes that are known now, each with both paths."""
        own = self._own
        if own.digest != self._own_digest:
            self._own_digest = own.digest
            kept = (item.resource for item in own.index if item.resource.kind is not Kind.BRANCH)
            self._numbers = {resource.data_id: resource for resource in kept}
            self._found.clear()
        found: dict[str, tuple[int, list[str]]] = {}
        for replica in self._replicas:
            known = self._found.get(replica.name)
            # only what has changed: each comparison reads a whole structure
            if known is None or known[0] != replica.digest:
                known = replica.digest, self._between(replica)
            found[replica.name] = known
        self._found = found
        return [*own.refused.values(), *(text for _, texts in found.values() for text in texts)]

    def _between(self, replica: Replica) -> list[str]:
        texts: list[str] = []
        for item in replica.index or ():
            theirs = item.resource
            if theirs.kind is Kind.BRANCH or (ours := self._numbers.get(theirs.data_id)) is None:
                continue
            if (ours.path, ours.type) != (theirs.path, theirs.type):
                texts.append(clash_text(join(replica.name, theirs.path), ours))
        return texts
