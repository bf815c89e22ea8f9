"""Descriptions of the payload types that the applications of a node define."""

from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from swarmware.model.resource import Resource
from swarmware.recorder.payload_type import logged_description

KEPT: Final = 1000
"""Maximum number of descriptions; they outlive their application, whose last values are recorded later."""


class Definitions(NamedTuple):
    """Resources and type descriptions that an application declares."""

    application: str
    provides: Iterable[Resource]
    types: Mapping[str, str]
    """Descriptions by the name of the type."""


class TypeDescriptions:
    """Finds the description of a resource's type among the declarations of the applications."""

    def __init__(self) -> None:
        self.found: Mapping[tuple[str, str], str] = {}
        """Descriptions by path and type; each change creates a new mapping, so that readers see it by
        identity."""

    def update(self, applications: Iterable[Definitions]) -> list[str]:
        """Applies the current applications; returns the types whose new description is invalid in a log."""
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
        # a dict keeps the order of insertion, so the oldest descriptions are evicted
        for key in list(found)[: max(0, len(found) - KEPT)]:
            del found[key]
        if found != self.found:
            self.found = found
        return refused
