"""Paths with equal numbers in frames, whose values and orders must not be mistaken for each other's."""

from collections.abc import Iterable

from swarmware.model.resource import Kind, Resource


def clashes(resources: Iterable[Resource]) -> dict[str, Resource]:
    """Paths whose number an earlier resource of another path or type has, and that resource.

    A number has 32 bits: among 200 resources one in 200 000 trees has a pair.
    """
    first: dict[int, Resource] = {}
    found: dict[str, Resource] = {}
    for resource in resources:
        if resource.kind is Kind.BRANCH:
            continue  # never in a frame
        other = first.setdefault(resource.data_id, resource)
        if (other.path, other.type) != (resource.path, resource.type):
            found[resource.path] = other
    return found


def clash_text(path: str, other: Resource) -> str:
    """The error about a path whose number another resource has."""
    return (
        f"{path}: its number {other.data_id:#010x} in frames belongs to {other.path} ({other.type});"
        " expected another name for one of them"
    )
