"""Lists resources of the swarm by the pattern of an operator."""

from typing import Final

import msgspec

from swarmctl.commandline import completion_cache
from swarmctl.commandline.completion_cache import VALUED, CachedResource
from swarmctl.session.session import Session, config_dir
from swarmware.errors import NotFound
from swarmware.model import names
from swarmware.types.tree import TreeEntry, TreeGet, TreeList, TreeListing, TreeValue

PAGE: Final = 2000
"""Maximum resources in one answer."""


def is_pattern(path: str) -> bool:
    """Whether it may match more than one path."""
    return any(char in path for char in "*{")


async def listing(session: Session, pattern: str) -> TreeListing:
    """All pages of the list; `/uav1` means all below it, empty the platform of the session, else all.

    Raises: NotFound when nothing matches, or the platform is not known.
    """
    if not pattern:
        full = f"/{session.settings.node}/**" if session.settings.node else "/**"
    elif is_pattern(pattern):
        full = pattern if pattern.startswith("/") else session.path(pattern)
    else:
        full = f"{session.path(pattern.rstrip('/') or '/')}/**" if pattern != "/" else "/**"
    found = await _pages(session, full)
    if not found.entries:
        platform = names.split(full)[0] or session.platform
        known = [one.platform for one in found.platforms]
        if not is_pattern(platform) and platform not in known:
            await session.reach(platform)
        there = ", ".join(sorted(known, key=names.natural))
        raise NotFound(f"{pattern or full}: no resource matches; platforms known to {session.here}: {there}")
    return found


async def valued(session: Session, path: str) -> list[TreeEntry]:
    """The resources with a value that a path or a pattern names.

    Raises: NotFound when there are none, NoAnswer when the platform is not reachable.
    """
    full = session.path(path)
    found = await _pages(session, full)
    entries = [entry for entry in found.entries if entry.kind in VALUED]
    if is_pattern(full):
        if not entries:
            raise NotFound(
                f"{full}: no resource with a value matches; `swarmctl tree ls` lists the resources"
            )
        return entries
    platform = names.split(names.check_path(full))[0] or session.platform
    await session.reach(platform)
    if not entries:
        # the error of its tree has the reason: an unknown path, a branch, a command
        await session.ask(names.join(session.here, "sys/tree/get"), TreeGet(full), TreeValue, about=full)
    return entries


async def consequence(session: Session, path: str) -> str:
    """Effect of setting the resource or a field, from its template; empty: no confirmation needed."""
    platform, local = names.split(names.check_path(path.partition(".")[0]))
    await session.reach(platform or session.here)
    found = await _pages(session, names.join(platform or session.here, local))
    return found.entries[0].confirm if found.entries else ""


async def _pages(session: Session, pattern: str) -> TreeListing:
    path = names.join(session.here, "sys/tree/list")
    found = await session.ask(path, TreeList(pattern, PAGE), TreeListing)
    entries = list(found.entries)
    while found.more and found.entries:
        found = await session.ask(path, TreeList(pattern, PAGE, found.entries[-1].path), TreeListing)
        entries += found.entries
    _remember(session, pattern, entries, [one.platform for one in found.platforms])
    return msgspec.structs.replace(found, entries=tuple(entries), more=0)


def _remember(session: Session, pattern: str, entries: list[TreeEntry], platforms: list[str]) -> None:
    """Stores the list for completion; a complete list of a platform replaces the former one."""
    if len(entries) < 2:
        return
    seen = [CachedResource(entry.path, entry.kind, entry.access) for entry in entries]
    whole = platforms if pattern == "/**" else [p for p in platforms if pattern == f"/{p}/**"]
    completion_cache.save(
        str(config_dir(session.settings)), sorted(platforms, key=names.natural), seen, whole
    )
