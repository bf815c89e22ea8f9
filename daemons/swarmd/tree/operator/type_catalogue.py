"""Descriptions and classes of payload types: types of every node, and types that applications define."""

from collections.abc import Iterable
from typing import Final

import msgspec

from swarmware.errors import NotFound, WireError
from swarmware.transport.appfile.entry import AppEntry
from swarmware.types import registry
from swarmware.types.described import class_of
from swarmware.types.description import TypeDescription, describe

KEPT: Final = 500
"""Descriptions that are kept after their application has ended, and of other platforms."""

_decoder = msgspec.json.Decoder(TypeDescription)


class TypeCatalogue:
    """Finds a type by its name, at this platform or as another platform has described it."""

    def __init__(self, platform: str, applications: Iterable[AppEntry]) -> None:
        """`applications`: the running applications, iterated at each question."""
        self._platform = platform
        self._applications = applications
        self._kept: dict[tuple[str, str], TypeDescription] = {}
        self._classes: dict[TypeDescription, type[msgspec.Struct]] = {}

    def description(self, name: str) -> TypeDescription:
        """Description of a type of this platform.

        Raises: NotFound, WireError for an invalid one of an application.
        """
        for entry in self._applications:
            if text := entry.types.get(name):
                try:
                    found = _decoder.decode(text)
                except (msgspec.DecodeError, ValueError, RecursionError) as error:
                    raise WireError(f"type {name!r} of {entry.id}: not a description: {error}") from error
                self.keep(self._platform, name, found)
                return found
        try:
            return self.kept(self._platform, name)
        except NotFound:
            # last: an application may define a type of the same name as an installed one
            return describe(registry.find(name))

    def keep(self, platform: str, name: str, found: TypeDescription) -> None:
        """Keep a description for when its owner is gone."""
        # removed first: insertion moves it to the end, so that the oldest goes first
        self._kept.pop((platform, name), None)
        self._kept[platform, name] = found
        while len(self._kept) > KEPT:
            del self._kept[next(iter(self._kept))]

    def kept(self, platform: str, name: str) -> TypeDescription:
        """The description that was kept. Raises: NotFound."""
        try:
            return self._kept[platform, name]
        except KeyError:
            raise NotFound(f"type {name!r}: {platform} has not described it") from None

    def cls(self, name: str) -> type[msgspec.Struct]:
        """The class of a type of this platform. Raises: NotFound, WireError."""
        try:
            return registry.find(name)
        except NotFound:
            description = self.description(name)
        made = self._classes.get(description)
        if made is None:
            if len(self._classes) >= KEPT:
                self._classes.clear()
            made = self._classes[description] = class_of(description)
        return made
