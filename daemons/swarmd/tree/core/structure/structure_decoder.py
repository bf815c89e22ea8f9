"""Decoder of structures in replies and notifications: applies changes to what both sides have."""

from collections.abc import Iterable
from typing import Final

from swarmd.tree.core.structure.index import Index, Leaf, leaf
from swarmd.tree.core.structure.structure import Patches, StructureEncoding
from swarmware.model.resource import Resource
from swarmware.types.tree_exchange import StructureReply, TreeNotify

TEMPLATES_LIMIT: Final = 64
"""Templates of other platforms that are kept."""


class StructureDecoder:
    """Decodes structures, and learns templates that it did not know."""

    def __init__(self, templates: Iterable[Iterable[Resource]]) -> None:
        self._templates: dict[int, Index] = {}
        for template in templates:
            index = Index(leaf(resource) for resource in template)
            self._templates[index.digest] = index
        self._patches = Patches()

    def of_reply(self, known: Index | None, reply: StructureReply) -> Index | None:
        """The structure in a reply, or None for an unknown base or another digest. Raises: WireError."""
        if reply.form == StructureEncoding.UNCHANGED:
            index = known
        else:
            patch = self._patches.decode(reply.data)
            index = self._base(known, reply, patch.template)
            if index is not None:
                patch.apply(index)
        # the digest is the proof that both sides have the same structure, whatever the encoding was
        return index if index is not None and index.digest == reply.digest else None

    def of_notification(self, known: Index | None, notify: TreeNotify) -> Index | None:
        """The structure after a notified change, or None if it is not relative to the known one.

        Raises: WireError.
        """
        if known is None or known.digest != notify.base or not notify.structure:
            return None
        index = known.copy()
        self._patches.decode(notify.structure).apply(index)
        return index if index.digest == notify.digest else None

    def _base(self, known: Index | None, reply: StructureReply, template: tuple[Leaf, ...]) -> Index | None:
        if reply.form == StructureEncoding.CHANGES:
            return None if known is None else known.copy()
        base = self._templates.get(reply.base)
        if base is None and reply.form == StructureEncoding.FULL:
            base = Index(template)  # bounded by the decoder
            if base.digest != reply.base:
                return None
            while len(self._templates) >= TEMPLATES_LIMIT:
                del self._templates[next(iter(self._templates))]
            self._templates[reply.base] = base
        return None if base is None else base.copy()
