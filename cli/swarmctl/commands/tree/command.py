"""`swarmctl tree`: resources: list, read, set and watch them."""

import click

from swarmctl import completion
from swarmctl.completion_cache import VALUED
from swarmctl.lazy import Group
from swarmctl.settings import settings


@click.group(cls=Group)
def cmd() -> None:
    """Resources: list, read, set and watch them, of one platform or of the whole swarm.

    Example: swarmctl tree ls '/*/nav/**'
    """


@cmd.command()
@click.argument("pattern", default="", shell_complete=completion.resources(VALUED | {"branch", "command"}))
@click.pass_context
def ls(ctx: click.Context, pattern: str) -> None:
    """List resources: type, unit, rate, age and quality of the value.

    Example: swarmctl tree ls /uav1
    """
    from swarmctl.output import Column
    from swarmctl.session import Session, run
    from swarmctl.tree_listing import listing

    async def work(session: Session) -> None:
        found = await listing(session, pattern)
        if session.settings.json:
            session.out.document(found)
            return
        rows = [
            (
                e.path,
                e.kind,
                e.type,
                e.unit,
                e.access,
                f"{e.rate_hz:g}" if e.rate_hz else None,
                None if e.age_s is None else f"{e.age_s:.2f}",
                None if e.quality == "none" else e.quality,
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
        session.out.table(columns, rows)

    run(settings(ctx), work)


@cmd.command()
@click.argument("pattern", default="", shell_complete=completion.resources(VALUED | {"branch", "command"}))
@click.pass_context
def show(ctx: click.Context, pattern: str) -> None:
    """Draw the tree.

    Example: swarmctl tree show /uav1
    """
    from swarmctl.commands.tree.drawing import tree
    from swarmctl.session import Session, run
    from swarmctl.tree_listing import listing

    async def work(session: Session) -> None:
        found = await listing(session, pattern)
        if session.settings.json:
            session.out.document(found)
        else:
            session.out.text("\n".join(tree(found.entries)))

    run(settings(ctx), work)


@cmd.command()
@click.argument("path", shell_complete=completion.resources(VALUED))
@click.option("--fresh", is_flag=True, help="Ask the owner even when a young mirror is here.")
@click.pass_context
def get(ctx: click.Context, path: str, fresh: bool) -> None:
    """Print the newest value of a resource, or of one of its fields; a pattern gives the values of all.

    Example: swarmctl tree get /uav1/nav/pose.x_m
    """
    from swarmctl.session import Session, run
    from swarmctl.tree_access import ResourceReading, read, read_all
    from swarmctl.tree_listing import is_pattern, valued
    from swarmctl.values import brief
    from swarmware.errors import Partial

    name, _, fields = path.partition(".")

    def warn_lost(session: Session, readings: list[ResourceReading]) -> None:
        for reading in readings:
            if reading.warning:
                session.out.warn(reading.warning)

    def shown(reading: ResourceReading) -> str:
        return brief(reading.value) + (f" {reading.unit}" if reading.unit and not fields else "")

    async def one(session: Session) -> None:
        found = await read(session, session.path(name), fields, fresh=fresh)
        warn_lost(session, [found])
        if session.settings.json:
            session.out.document(found)
            return
        session.out.text(shown(found))
        age = "of unknown age" if found.age_s is None else f"{found.age_s:.3f} s old"
        session.out.detail(f"{found.path}: {found.type}, {age}, {found.quality}, from {found.source}")

    async def many(session: Session) -> None:
        entries = await valued(session, name)
        found, errors = await read_all(session, [entry.path for entry in entries], fields, fresh=fresh)
        warn_lost(session, found)
        if session.settings.json:
            session.out.document({"values": found})
        else:
            width = max((len(reading.path) for reading in found), default=0)
            for reading in found:
                session.out.text(f"{reading.path:<{width}}  {shown(reading)}")
        for error in errors:
            session.out.warn(str(error))
        if errors and not found:
            raise errors[0]
        if errors:
            raise Partial(f"{name}: {len(errors)} of {len(entries)} gave no value")

    run(settings(ctx), many if is_pattern(name) else one)


@cmd.command(name="set", context_settings={"ignore_unknown_options": True})
@click.argument("path", shell_complete=completion.resources(VALUED | {"command"}, "w"))
@click.argument("value")
@click.option("--if-version", "version", type=int, metavar="N", help="Only if it still has this version.")
@click.option("--yes", is_flag=True, help="Do not ask where the resource wants it, such as for arming.")
@click.pass_context
def set_(ctx: click.Context, path: str, value: str, version: int | None, yes: bool) -> None:
    """Set a resource, or one of its fields; the owner checks type, range and right.

    Where its template says that setting it needs a confirmation, it is asked for.

    Example: swarmctl tree set /uav1/config/navigator/altitude_kp 1.5
    """
    from swarmctl.confirmation import confirm
    from swarmctl.session import Session, run
    from swarmctl.tree_access import write
    from swarmctl.tree_listing import consequence
    from swarmctl.values import brief

    async def work(session: Session) -> None:
        if will := await consequence(session, session.path(path)):
            confirm(yes, f"set {session.path(path)}: {will}")
        done = await write(session, session.path(path), value, version)
        if session.settings.json:
            session.out.document(done)
        else:
            session.out.text(f"{done.path} = {brief(done.value)} (version {done.version})")

    run(settings(ctx), work)


@cmd.command()
@click.argument("path", shell_complete=completion.resources(VALUED))
@click.option("--count", type=click.IntRange(min=1), metavar="N", help="End after N values.")
@click.pass_context
def watch(ctx: click.Context, path: str, count: int | None) -> None:
    """Print each new value of a resource, of one of its fields, or of all that match; Ctrl-C ends it.

    Example: swarmctl tree watch /uav1/nav/pose --count 10 --json
    """
    import msgspec

    from swarmctl.commands.tree.watching import ResourceWatch
    from swarmctl.session import Session, run
    from swarmctl.tree_listing import is_pattern, valued
    from swarmctl.values import brief, field
    from swarmware.errors import Partial

    name, _, fields = path.partition(".")

    async def work(session: Session) -> None:
        entries = await valued(session, name)
        watched = await ResourceWatch.open(session, entries)
        seen = 0
        async for news in watched:
            value = field(news.value, news.path, fields)
            if session.settings.json:
                session.out.line(msgspec.structs.replace(news, value=value))
            else:
                session.out.now(f"{news.path}  {brief(value)}" if is_pattern(name) else brief(value))
            seen += 1
            if seen == count:
                break
        if watched.lost:
            raise Partial(f"{name}: {watched.lost} values were overwritten before they were read")

    run(settings(ctx), work)
