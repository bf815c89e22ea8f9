"""`swarmctl node`: nodes of the swarm."""

import click

from swarmctl import completion
from swarmctl.lazy import Group
from swarmctl.settings import settings


@click.group(cls=Group)
def cmd() -> None:
    """Nodes of the swarm.

    Example: swarmctl node ls
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List the nodes: whether they answer, health, mission; of vehicles mode, armed, height and battery.

    Example: swarmctl node ls --json
    """
    from swarmctl.commands.node.overview import overview, table
    from swarmctl.fanout import warn_errors
    from swarmctl.session import Session, run
    from swarmware.errors import Partial

    async def work(session: Session) -> None:
        nodes, errors = await overview(session)
        if session.settings.node and errors:
            raise errors[session.platform]
        if session.settings.json:
            session.out.document({"nodes": nodes})
        else:
            session.out.table(*table(session, nodes))
        warn_errors(session, errors)
        if errors:
            raise Partial(f"nodes: {len(errors)} of {len(nodes)} did not answer")

    run(settings(ctx), work)


@cmd.command()
@click.argument("platform", required=False, shell_complete=completion.platforms)
@click.pass_context
def info(ctx: click.Context, platform: str | None) -> None:
    """Show one node: who it is, its services, and where its configuration is.

    Example: swarmctl node info uav1
    """
    from swarmctl.output import Column
    from swarmctl.quantities import spoken
    from swarmctl.session import Session, run
    from swarmware import names
    from swarmware.types.rpc import Empty
    from swarmware.types.system import NodeInfo

    async def work(session: Session) -> None:
        target = names.check_platform(platform or session.platform)
        found = await session.ask(f"/{target}/sys/node/info", Empty(), NodeInfo)
        if session.settings.json:
            session.out.document(found)
            return
        rows = [
            ("platform", f"{found.platform}, unit {found.unit}"),
            ("kind", f"{found.kind}, template {found.template}"),
            ("version", found.version),
            ("up", spoken(found.uptime_s)),
            ("services", ", ".join(found.services)),
            ("processes", found.processes),
            ("configuration", found.config_dir),
            ("boot", f"{found.boot_id:016x}"),
        ]
        session.out.table([Column("WHAT"), Column("IS")], rows)

    run(settings(ctx), work)
