"""`swarmctl config`: settings of the nodes."""

import click

from swarmctl.lazy import Group
from swarmctl.settings import settings


@click.group(cls=Group)
def cmd() -> None:
    """Settings of the nodes: files of an administrator, and live ones that are resources of the tree.

    Example: swarmctl config set navigator/cruise_m_s 2.0 --node uav1
    """


@cmd.command()
@click.argument("service", default="")
@click.option("--changed", is_flag=True, help="Only what differs from the defaults.")
@click.pass_context
def show(ctx: click.Context, service: str, changed: bool) -> None:
    """Show the files of the node that was joined: each key, its value, and where it comes from.

    Example: swarmctl config show broker
    """
    from swarmctl.configuration import effective
    from swarmctl.connect import config_dir
    from swarmctl.output import Column, Output

    out = Output(settings(ctx))
    rows = effective(config_dir(settings(ctx)), service)
    if changed:
        rows = [row for row in rows if row.origin != "default"]
    if settings(ctx).json:
        out.document({"settings": rows})
        return
    out.table(
        [Column("SERVICE"), Column("KEY"), Column("VALUE"), Column("FROM")],
        [(row.service, row.key, row.value, row.origin) for row in rows],
    )


@cmd.command()
@click.argument("key", default="**")
@click.pass_context
def get(ctx: click.Context, key: str) -> None:
    """Print live settings of a platform: one, or all that match.

    Example: swarmctl config get navigator/cruise_m_s --node uav1
    """
    from swarmctl.connect import Link, run
    from swarmctl.output import Column
    from swarmctl.values import brief, decoded
    from swarmware.errors import NotFound
    from swarmware.types.tree import TreeGet, TreeList, TreeListing, TreeValue

    async def work(link: Link) -> None:
        pattern = link.path(f"config/{key}")
        listing = await link.ask(f"/{link.here}/sys/tree/list", TreeList(pattern), TreeListing)
        found = []
        for entry in listing.entries:
            if entry.kind == "setting":
                value = await link.ask(f"/{link.here}/sys/tree/get", TreeGet(entry.path), TreeValue)
                found.append((entry, decoded(value), value.version))
        if not found:
            raise NotFound(
                f"{pattern}: no setting matches; `swarmctl config get --node {link.platform}` lists all"
            )
        if link.settings.json:
            link.out.document(
                {
                    "settings": [
                        {"path": e.path, "value": value, "unit": e.unit, "range": e.range, "version": version}
                        for e, value, version in found
                    ]
                }
            )
        elif len(found) == 1 and "*" not in key:
            link.out.text(brief(found[0][1]))
        else:
            rows = [
                (
                    e.path,
                    brief(value),
                    e.unit,
                    f"{e.range[0]:g}..{e.range[1]:g}" if e.range else None,
                    version,
                )
                for e, value, version in found
            ]
            columns = [Column("PATH"), Column("VALUE"), Column("UNIT"), Column("RANGE"), Column("VERSION")]
            link.out.table(columns, rows)

    run(settings(ctx), work)


@cmd.command(name="set", context_settings={"ignore_unknown_options": True})
@click.argument("key")
@click.argument("value")
@click.pass_context
def set_(ctx: click.Context, key: str, value: str) -> None:
    """Set a live setting of a platform; it is checked, kept over restarts, and takes effect at once.

    Example: swarmctl config set navigator/cruise_m_s 2.0 --node uav1
    """
    from swarmctl.connect import Link, run
    from swarmctl.values import brief, decoded_payload, typed
    from swarmware.types.tree import TreeSet, TreeSetDone

    async def work(link: Link) -> None:
        wish = TreeSet(link.path(f"config/{key}"), typed(value), None, f"operator@{link.here}")
        done = await link.ask(f"/{link.here}/sys/tree/set", wish, TreeSetDone)
        now = decoded_payload(done.type, done.data)
        if link.settings.json:
            link.out.document({"path": done.path, "value": now, "version": done.version})
        else:
            link.out.text(f"{done.path} = {brief(now)} (version {done.version})")

    run(settings(ctx), work)
