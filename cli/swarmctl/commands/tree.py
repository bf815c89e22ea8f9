"""`swarmctl tree`: resources: list, read, set and watch them."""

from typing import TYPE_CHECKING

import click

from swarmctl.lazy import Group
from swarmctl.settings import settings

if TYPE_CHECKING:
    from swarmctl.connect import Link
    from swarmware.types.tree import TreeListing

PAGE = 2000


@click.group(cls=Group)
def cmd() -> None:
    """Resources: list, read, set and watch them, of one platform or of the whole swarm.

    Example: swarmctl tree ls '/*/nav/**'
    """


@cmd.command()
@click.argument("pattern", default="")
@click.pass_context
def ls(ctx: click.Context, pattern: str) -> None:
    """List resources: type, unit, rate, age and quality of the value.

    Example: swarmctl tree ls /uav1
    """
    from swarmctl.connect import Link, run
    from swarmctl.output import Column
    from swarmware.errors import NotFound

    async def work(link: Link) -> None:
        found = await _list(link, pattern)
        if link.settings.json:
            link.out.document(found)
        else:
            rows = [
                (
                    e.path,
                    e.kind,
                    e.type,
                    e.unit,
                    e.access,
                    f"{e.rate_hz:g}" if e.rate_hz else None,
                    None if e.age_s is None else f"{e.age_s:.2f}",
                    e.quality,
                    e.owner,
                )
                for e in found.entries
            ]
            columns = [
                Column("PATH"),
                Column("KIND"),
                Column("TYPE"),
                Column("UNIT"),
                Column("ACCESS"),
                Column("HZ", right=True),
                Column("AGE s", right=True),
                Column("QUALITY"),
                Column("OWNER"),
            ]
            link.out.table(columns, rows)
        if not found.entries:
            known = ", ".join(one.platform for one in found.platforms)
            raise NotFound(f"{pattern or '/**'}: no resource matches; platforms known here: {known}")

    run(settings(ctx), work)


@cmd.command()
@click.argument("pattern", default="")
@click.pass_context
def show(ctx: click.Context, pattern: str) -> None:
    """Draw the tree.

    Example: swarmctl tree show /uav1
    """
    from swarmctl.connect import Link, run
    from swarmctl.drawing import tree

    async def work(link: Link) -> None:
        found = await _list(link, pattern)
        if link.settings.json:
            link.out.document(found)
            return
        link.out.text("\n".join(tree(found.entries)))

    run(settings(ctx), work)


@cmd.command()
@click.argument("path")
@click.option("--fresh", is_flag=True, help="Ask the owner even when a young mirror is here.")
@click.pass_context
def get(ctx: click.Context, path: str, fresh: bool) -> None:
    """Print the newest value of a resource, or of one of its fields.

    Example: swarmctl tree get /uav1/nav/pose.x_m
    """
    from swarmctl.connect import Link, run
    from swarmctl.values import brief, decoded, field
    from swarmware.types.tree import TreeGet, TreeValue

    async def work(link: Link) -> None:
        name, _, fields = path.partition(".")
        found = await link.ask(f"/{link.here}/sys/tree/get", TreeGet(link.path(name), fresh), TreeValue)
        value = field(decoded(found), found.path, fields)
        if not link.settings.json:
            link.out.text(brief(value) + (f" {found.unit}" if found.unit else ""))
            age = "unknown age" if found.age_s is None else f"{found.age_s:.3f} s old"
            link.out.detail(f"{found.path}: {found.type}, {age}, {found.quality}, from {found.source}")
            return
        link.out.document(
            {
                "path": found.path,
                "type": found.type,
                "unit": found.unit,
                "value": value,
                "stamp_ns": found.stamp_ns,
                "age_s": found.age_s,
                "sequence": found.sequence,
                "version": found.version,
                "quality": found.quality,
                "owner": found.owner,
                "source": found.source,
            }
        )

    run(settings(ctx), work)


@cmd.command(name="set", context_settings={"ignore_unknown_options": True})
@click.argument("path")
@click.argument("value")
@click.option("--if-version", "version", type=int, metavar="N", help="Only if it still has this version.")
@click.pass_context
def set_(ctx: click.Context, path: str, value: str, version: int | None) -> None:
    """Set a resource, or one of its fields; the owner checks type, range and right.

    Example: swarmctl tree set /uav1/config/navigator/cruise_m_s 2.5
    """
    from swarmctl.connect import Link, run
    from swarmctl.values import brief, decoded_payload, typed
    from swarmware.types.tree import TreeSet, TreeSetDone

    async def work(link: Link) -> None:
        wish = TreeSet(link.path(path), typed(value), version, f"operator@{link.here}")
        done = await link.ask(f"/{link.here}/sys/tree/set", wish, TreeSetDone)
        now = decoded_payload(done.type, done.data)
        if link.settings.json:
            link.out.document({"path": done.path, "type": done.type, "value": now, "version": done.version})
        else:
            link.out.text(f"{done.path} = {brief(now)} (version {done.version})")

    run(settings(ctx), work)


@cmd.command()
@click.argument("path")
@click.option("--count", type=click.IntRange(min=1), metavar="N", help="End after N values.")
@click.pass_context
def watch(ctx: click.Context, path: str, count: int | None) -> None:
    """Print each new value of a resource as it comes; Ctrl-C ends it.

    Example: swarmctl tree watch /uav1/nav/pose --count 10 --json
    """
    from swarmctl.connect import Link, run
    from swarmctl.values import brief
    from swarmware.record.entry import plain
    from swarmware.types import registry
    from swarmware.types.tree import TreeGet, TreeValue

    async def work(link: Link) -> None:
        name = link.path(path)
        # the first value tells the type, and an unknown path or a silent platform at once
        first = await link.ask(f"/{link.here}/sys/tree/get", TreeGet(name), TreeValue)
        reader = await link.module.reader(name, registry.find(first.type))
        seen = 0
        async for value in reader:
            if link.settings.json:
                line = {"path": name, "type": first.type, "stamp_ns": reader.stamp_ns, "age_s": reader.age_s}
                link.out.line({**line, "value": plain(value)})
            else:
                link.out.text(brief(plain(value)))
            seen += 1
            if seen == count:
                return

    run(settings(ctx), work)


async def _list(link: "Link", pattern: str) -> "TreeListing":
    """All pages; `/uav1` means everything below it, nothing means the platform asked about or all."""
    import msgspec

    from swarmware.types.tree import TreeList, TreeListing

    if not pattern:
        pattern = f"/{link.settings.node}/**" if link.settings.node else "/**"
    elif not any(char in pattern for char in "*{"):
        pattern = f"{link.path(pattern).rstrip('/')}/**"
    elif not pattern.startswith("/"):
        pattern = link.path(pattern)
    path = f"/{link.here}/sys/tree/list"
    found = await link.ask(path, TreeList(pattern, PAGE), TreeListing)
    entries = list(found.entries)
    while found.more and found.entries:
        found = await link.ask(path, TreeList(pattern, PAGE, found.entries[-1].path), TreeListing)
        entries += found.entries
    return msgspec.structs.replace(found, entries=tuple(entries), more=0)
