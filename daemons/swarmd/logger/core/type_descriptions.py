"""Descriptions of the payload types that the applications of a node define."""

from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from swarmware.model.resource import Resource
from swarmware.recorder.payload_type import logged_description

KEPT: Final = 1000
"""Descriptions that are kept after their application has ended: its last values are recorded later."""


class Definitions(NamedTuple):
    """What an application declares about its types."""

    application: str
    provides: Iterable[Resource]
    types: Mapping[str, str]
    """Descriptions by name."""


class TypeDescriptions:
    """Finds the description of a resource's type in the entries of the applications that provide it."""

    def __init__(self) -> None:
        self.found: Mapping[tuple[str, str], str] = {}
        """By path and type; a change makes a new object."""

    def update(self, applications: Iterable[Definitions]) -> list[str]:
        """Applies the current applications; the types with a new description that a log cannot have."""
        found, refused = dict(self.found), []
        for entry in applications:
            for resource in entry.provides:
                key = resource.path, resource.type
                text = entry.types.get(resource.type, "")
                logged = logged_description(text) if text else ""
                if text and not logged and found.get(key) != "":
                    refused.append(f"{resource.type} of {entry.application}")
                if text:
                    found[key] = logged
                else:
                    found.pop(key, None)
        for key in list(found)[: max(0, len(found) - KEPT)]:
            del found[key]
        if found != self.found:
            self.found = found
        return refused
