"""`swarmctl config`: settings of the nodes."""

import click

from swarmctl import completing
from swarmctl.lazy import Group
from swarmctl.settings import settings


@click.group(cls=Group)
def cmd() -> None:
    """Settings of the nodes: files of an administrator, and live ones that are resources of the tree.

    Example: swarmctl config get --node uav1
    """


@cmd.command()
@click.argument("service", default="")
@click.option("--changed", is_flag=True, help="Only what differs from the defaults.")
@click.pass_context
def show(ctx: click.Context, service: str, changed: bool) -> None:
    """Show the files of a node on this machine: each key, its value, and where it comes from.

    Example: swarmctl config show broker
    """
    from swarmctl.configuration import effective
    from swarmctl.connect import folder_asked
    from swarmctl.output import Column, Output

    out = Output(settings(ctx))
    rows = effective(folder_asked(settings(ctx)), service)
    if changed:
        rows = [row for row in rows if row.origin != "default"]
    if settings(ctx).json:
        out.document({"settings": rows})
        return
    out.table(
        [Column("SERVICE"), Column("KEY"), Column("FROM"), Column("VALUE")],
        [(row.service, row.key, row.origin, row.value) for row in rows],
    )


@cmd.command()
@click.argument("key", default="**", shell_complete=completing.live_settings)
@click.pass_context
def get(ctx: click.Context, key: str) -> None:
    """Print live settings of a platform: one, or all that match.

    Example: swarmctl config get navigator/altitude_kp --node uav1
    """
    from swarmctl.connect import Link, run
    from swarmctl.listing import is_pattern, valued
    from swarmctl.output import Column
    from swarmctl.reading import read_all
    from swarmctl.values import brief
    from swarmware.errors import NotFound

    async def work(link: Link) -> None:
        await link.reach(link.platform)
        try:
            entries = await valued(link, f"config/{key}")
        except NotFound as error:
            if is_pattern(key):
                raise NotFound(f"{link.platform}: no live setting matches {key!r}") from error
            raise
        readings, errors = await read_all(link, [entry.path for entry in entries])
        if errors:
            raise errors[0]
        limits = {entry.path: entry.range for entry in entries}
        if link.settings.json:
            found = [
                {
                    "path": r.path,
                    "value": r.value,
                    "unit": r.unit,
                    "range": limits[r.path],
                    "version": r.version,
                }
                for r in readings
            ]
            link.out.document({"settings": found})
        elif not is_pattern(key):
            link.out.text(brief(readings[0].value))
        else:
            rows = []
            for r in readings:
                limit = limits[r.path]
                shown = f"{limit[0]:g}..{limit[1]:g}" if limit else None
                rows.append((r.path, brief(r.value), r.unit, shown, r.version))
            columns = [Column("PATH"), Column("VALUE"), Column("UNIT"), Column("RANGE"), Column("VERSION")]
            link.out.table(columns, rows)

    run(settings(ctx), work)


@cmd.command(name="set", context_settings={"ignore_unknown_options": True})
@click.argument("key", shell_complete=completing.live_settings)
@click.argument("value")
@click.option("--yes", is_flag=True, help="Do not ask where the setting wants it.")
@click.pass_context
def set_(ctx: click.Context, key: str, value: str, yes: bool) -> None:
    """Set a live setting of a platform; it is checked, kept over restarts, and takes effect at once.

    Example: swarmctl config set navigator/altitude_kp 1.5 --node uav1
    """
    from swarmctl.asking import confirm
    from swarmctl.connect import Link, run
    from swarmctl.listing import consequence
    from swarmctl.reading import write
    from swarmctl.values import brief

    async def work(link: Link) -> None:
        path = link.path(f"config/{key}")
        if will := await consequence(link, path):
            confirm(yes, f"set {path}: {will}")
        done = await write(link, path, value)
        if link.settings.json:
            link.out.document(done)
        else:
            link.out.text(f"{done.path} = {brief(done.value)} (version {done.version})")

    run(settings(ctx), work)
