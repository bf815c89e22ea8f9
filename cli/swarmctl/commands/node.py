"""`swarmctl node`: nodes of the swarm."""

import click

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
    """List the nodes that can be reached: kind, way, age of the tree, health, mission.

    Example: swarmctl node ls --json
    """
    from swarmctl.connect import Link, run
    from swarmctl.output import Column
    from swarmctl.survey import ask_all, complain, platforms
    from swarmware.errors import Partial
    from swarmware.types.net import Routes
    from swarmware.types.rpc import Empty
    from swarmware.types.system import NodeInfo

    async def work(link: Link) -> None:
        asked = await platforms(link)
        routes = await link.ask(f"/{link.here}/sys/broker/routes", Empty(), Routes)
        infos, errors = await ask_all(link, asked, "sys/node/info", Empty(), NodeInfo)
        ways = {route.platform: route for route in routes.routes}
        if link.settings.json:
            nodes = [
                {"platform": platform, "info": infos.get(platform), "route": ways.get(platform)}
                for platform in asked
            ]
            link.out.document({"nodes": nodes})
        else:
            rows = []
            for platform in asked:
                info, way = infos.get(platform), ways.get(platform)
                rows.append(
                    (
                        platform,
                        info.kind if info else None,
                        "answers" if info else "silent",
                        info.uptime_s if info else None,
                        len(info.services) if info else None,
                        info.processes if info else None,
                        way.via if way else None,
                        way.hops if way else 0,
                        info.version if info else None,
                    )
                )
            columns = [
                Column("NODE"),
                Column("KIND"),
                Column("STATE"),
                Column("UP s", right=True),
                Column("SERVICES", right=True),
                Column("PROCESSES"),
                Column("VIA"),
                Column("HOPS", right=True),
                Column("VERSION"),
            ]
            link.out.table(columns, rows)
        complain(link, errors)
        if errors:
            raise Partial(f"nodes: {len(errors)} of {len(asked)} did not answer")

    run(settings(ctx), work)


@cmd.command()
@click.argument("platform", required=False)
@click.pass_context
def info(ctx: click.Context, platform: str | None) -> None:
    """Show one node: services, start, versions, health.

    Example: swarmctl node info uav1
    """
    import msgspec

    from swarmctl.connect import Link, run
    from swarmctl.output import Column
    from swarmware import names
    from swarmware.types.rpc import Empty
    from swarmware.types.system import NodeInfo

    async def work(link: Link) -> None:
        target = names.check_platform(platform or link.platform)
        found = await link.ask(f"/{target}/sys/node/info", Empty(), NodeInfo)
        if link.settings.json:
            link.out.document(found)
            return
        rows = [
            (name, ", ".join(value) if isinstance(value, tuple | list) else value)
            for name, value in msgspec.structs.asdict(found).items()
        ]
        link.out.table([Column("WHAT"), Column("IS")], rows)

    run(settings(ctx), work)
