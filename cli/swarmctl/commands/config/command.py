"""`swarmctl config`: settings of the nodes."""

import click

from swarmctl import completion
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
    from swarmctl.commands.config.effective import effective
    from swarmctl.output import Column, Output
    from swarmctl.session import local_config_dir

    out = Output(settings(ctx))
    rows = effective(local_config_dir(settings(ctx)), service)
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
@click.argument("key", default="**", shell_complete=completion.live_settings)
@click.pass_context
def get(ctx: click.Context, key: str) -> None:
    """Print live settings of a platform: one, or all that match.

    Example: swarmctl config get navigator/altitude_kp --node uav1
    """
    from swarmctl.output import Column
    from swarmctl.session import Session, run
    from swarmctl.tree_access import read_all
    from swarmctl.tree_listing import is_pattern, valued
    from swarmctl.values import brief
    from swarmware.errors import NotFound

    async def work(session: Session) -> None:
        await session.reach(session.platform)
        try:
            entries = await valued(session, f"config/{key}")
        except NotFound as error:
            if is_pattern(key):
                raise NotFound(f"{session.platform}: no live setting matches {key!r}") from error
            raise
        readings, errors = await read_all(session, [entry.path for entry in entries])
        if errors:
            raise errors[0]
        limits = {entry.path: entry.range for entry in entries}
        if session.settings.json:
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
            session.out.document({"settings": found})
        elif not is_pattern(key):
            session.out.text(brief(readings[0].value))
        else:
            rows = []
            for r in readings:
                limit = limits[r.path]
                shown = f"{limit[0]:g}..{limit[1]:g}" if limit else None
                rows.append((r.path, brief(r.value), r.unit, shown, r.version))
            columns = [Column("PATH"), Column("VALUE"), Column("UNIT"), Column("RANGE"), Column("VERSION")]
            session.out.table(columns, rows)

    run(settings(ctx), work)


@cmd.command(name="set", context_settings={"ignore_unknown_options": True})
@click.argument("key", shell_complete=completion.live_settings)
@click.argument("value")
@click.option("--yes", is_flag=True, help="Do not ask where the setting wants it.")
@click.pass_context
def set_(ctx: click.Context, key: str, value: str, yes: bool) -> None:
    """Set a live setting of a platform; it is checked, kept over restarts, and takes effect at once.

    Example: swarmctl config set navigator/altitude_kp 1.5 --node uav1
    """
    from swarmctl.confirmation import confirm
    from swarmctl.session import Session, run
    from swarmctl.tree_access import write
    from swarmctl.tree_listing import consequence
    from swarmctl.values import brief

    async def work(session: Session) -> None:
        path = session.path(f"config/{key}")
        if will := await consequence(session, path):
            confirm(yes, f"set {path}: {will}")
        done = await write(session, path, value)
        if session.settings.json:
            session.out.document(done)
        else:
            session.out.text(f"{done.path} = {brief(done.value)} (version {done.version})")

    run(settings(ctx), work)
