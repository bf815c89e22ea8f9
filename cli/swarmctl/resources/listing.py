"""Lists resources of the swarm by the pattern of an operator."""

import asyncio
from collections.abc import Collection
from typing import Final

import msgspec

from swarmctl.commandline import completion_cache, word_cache
from swarmctl.commandline.completion_cache import VALUED, CachedResource
from swarmctl.session.session import Session, config_dir
from swarmware.errors import NotFound, SwarmError
from swarmware.model import names
from swarmware.types import registry
from swarmware.types.field_values import field_values
from swarmware.types.tree import TreeEntry, TreeGet, TreeList, TreeListing, TreeValue

PAGE: Final = 2000
"""Maximum resources in one answer."""


def is_pattern(path: str) -> bool:
    """Whether a path is a pattern, which may match several paths."""
    return any(char in path for char in "*{")


async def listing(session: Session, pattern: str) -> TreeListing:
    """All resources that match; `/uav1` means all below it, and "" all of the selected platforms.

    Raises: NotFound when nothing matches, or the platform is not known.
    """
    await session.check_selected(pattern)
    if not pattern:
        full = session.path("**") if session.settings.node else "/**"
    elif is_pattern(pattern):
        full = session.path(pattern)
    else:
        full = f"{session.path(pattern.rstrip('/') or '/')}/**" if pattern != "/" else "/**"
    found = await pages(session, full)
    if not found.entries:
        platform = names.split(full)[0] or session.platform
        known = [one.platform for one in found.platforms]
        if not is_pattern(platform) and platform not in known:
            await session.reach(platform)
        there = ", ".join(sorted(known, key=names.natural))
        near = f"did you mean /{pattern}? " if pattern.partition("/")[0] in known else ""
        raise NotFound(
            f"{pattern or full}: no resource matches; {near}platforms known to {session.here}: {there}"
        )
    return found


async def at_owners(session: Session, found: TreeListing) -> TreeListing:
    """The list with ages, qualities and measured rates as their owners know them.

    The entries of a platform that does not answer stay as known here; an unreachable platform is not asked.
    """
    reachable = {one.platform for one in found.platforms if one.reachable} - {session.here}
    by_platform: dict[str, list[str]] = {}
    for entry in found.entries:
        platform, local = names.split(entry.path)
        if platform in reachable and entry.kind in VALUED:
            by_platform.setdefault(platform, []).append(local)

    async def ask(platform: str, paths: list[str]) -> list[TreeEntry]:
        try:
            return list((await pages(session, names.join(platform, _common(paths)), platform)).entries)
        except SwarmError as error:
            session.out.warn(f"{platform}: ages and rates as seen from {session.here}: {error}")
            return []

    answers = await asyncio.gather(*(ask(*item) for item in by_platform.items()))
    owners = {entry.path: entry for answer in answers for entry in answer}
    merged = [_as_owned(entry, owners.get(entry.path)) for entry in found.entries]
    return msgspec.structs.replace(found, entries=tuple(merged))


def _as_owned(entry: TreeEntry, known: TreeEntry | None) -> TreeEntry:
    """An entry with the age, quality, rates and rule that its owner reports."""
    if known is None:
        return entry
    # a resource without a value at its owner keeps what this node has; only the rule is certain there
    if known.age_s is None:
        return msgspec.structs.replace(entry, rule=known.rule)
    return msgspec.structs.replace(
        entry, age_s=known.age_s, quality=known.quality, measured_hz=known.measured_hz, rule=known.rule
    )


def _common(paths: list[str]) -> str:
    """A pattern that all of these local paths match: their one path, or all below their common branch."""
    if len(paths) == 1:
        return paths[0]
    parts: list[str] = []
    for column in zip(*(path.split("/") for path in paths), strict=False):
        if len(set(column)) > 1:
            break
        parts.append(column[0])
    return "/".join([*parts, "**"])


async def valued(session: Session, path: str) -> list[TreeEntry]:
    """The resources with a value that a path or a pattern names.

    Raises: NotFound when there are none, NoAnswer when the platform is not reachable.
    """
    await session.check_selected(path)
    full = session.path(path)
    found = await pages(session, full)
    entries = [entry for entry in found.entries if entry.kind in VALUED]
    if is_pattern(full):
        if not entries:
            known = [one.platform for one in found.platforms]
            near = f"did you mean /{path}?" if path.partition("/")[0] in known else ""
            near = near or "`swarmctl tree ls` lists the resources"
            raise NotFound(f"{full}: no resource with a value matches; {near}")
        return entries
    platform = names.split(names.check_path(full))[0] or session.platform
    await session.reach(platform)
    entry = entries[0] if entries else await _at_owner(session, platform, full)
    if entry is None or entry.kind not in VALUED:
        # the error of its tree has the reason: an unknown path, a branch, a command
        await ask_value(session, full)
        raise NotFound(f"{full}: no such resource; expected a path that `swarmctl tree ls` shows")
    return [entry]


async def ask_value(session: Session, full: str) -> None:
    """Asks the owner for a value to get its error, which names the reason for a missing resource."""
    owner = names.split(full)[0] or session.here
    await session.ask(names.join(owner, "sys/tree/get"), TreeGet(full), TreeValue, about=full)


async def _at_owner(session: Session, platform: str, full: str) -> TreeEntry | None:
    """The resource as its own platform lists it, because a new resource is known there first."""
    if platform == session.here:
        return None
    found = await pages(session, full, platform)
    return found.entries[0] if found.entries else None


async def pages(session: Session, pattern: str, platform: str = "") -> TreeListing:
    """All pages of a list of the joined node, or of another platform."""
    path = names.join(platform or session.here, "sys/tree/list")
    found = await session.ask(path, TreeList(pattern, PAGE), TreeListing)
    entries = list(found.entries)
    while found.more and found.entries:
        found = await session.ask(path, TreeList(pattern, PAGE, found.entries[-1].path), TreeListing)
        entries += found.entries
    if not platform:
        _remember(session, pattern, entries, [one.platform for one in found.platforms])
    return msgspec.structs.replace(found, entries=tuple(entries), more=0)


def _remember(session: Session, pattern: str, entries: list[TreeEntry], platforms: list[str]) -> None:
    """Stores the list for completion; a complete list of a platform replaces the former one."""
    # the list of a single path is a look-up, not worth a write of the cache
    if len(entries) < 2:
        return
    seen = [CachedResource(entry.path, entry.kind, entry.access) for entry in entries]
    whole = platforms if pattern == "/**" else [p for p in platforms if pattern == f"/{p}/**"]
    way = str(config_dir(session.settings))
    completion_cache.save(way, sorted(platforms, key=names.natural), seen, whole)
    types = {name for entry in entries if (name := entry.type)}
    new = types - word_cache.load().fields.keys()  # to describe a type takes longer than to list it
    known = {name for name in new if registry.installed(name)}
    fields = {name: field_values(registry.find(name)) for name in known}
    if unknown := new - known:
        owners = {str(names.split(entry.path)[0]) for entry in entries if entry.type in unknown}
        fields |= described_fields(session, owners, unknown)
    fields |= {entry.path: {"value": list(entry.choices)} for entry in entries if entry.choices}
    word_cache.save(way, {entry.path: entry.type for entry in entries if entry.type}, fields)


def described_fields(
    session: Session, platforms: Collection[str], types: Collection[str]
) -> dict[str, dict[str, list[str]]]:
    """Fields of types that applications of this machine describe in their files, for completion.

    By the name of the type, of platforms on this machine; an invalid description is left out.
    """
    # only the first list with a new type of a module needs them
    from swarmctl.session import labs
    from swarmware.transport.appfile import table
    from swarmware.types.described import class_of
    from swarmware.types.description import TypeDescription

    lab = labs.chosen(session.settings)
    if lab is None:
        folders = [session.module.node.config.run_path] if session.here in platforms else []
    else:
        folders = [node.run_dir for node in lab.nodes if node.platform in platforms]
    found: dict[str, dict[str, list[str]]] = {}
    for entry in (entry for folder in folders for entry in table.scan(folder)):
        for name in entry.types.keys() & types:
            try:
                description = msgspec.json.decode(entry.types[name], type=TypeDescription)
                found[name] = field_values(class_of(description))
            except (msgspec.DecodeError, ValueError, RecursionError, SwarmError):
                continue  # as without a description
    return found
