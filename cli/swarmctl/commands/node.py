"""`swarmctl node`: nodes of the swarm."""

import click

from swarmctl import completing
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
    """List the nodes: whether they answer, since when they are up, health, mission, and the way to them.

    Example: swarmctl node ls --json
    """
    from swarmctl.connect import Link, run
    from swarmctl.output import Column
    from swarmctl.quantities import spoken
    from swarmctl.survey import ask_all, boards, complain, platforms
    from swarmware.errors import Partial
    from swarmware.types.health import HealthState
    from swarmware.types.mission import MissionState
    from swarmware.types.rpc import Empty
    from swarmware.types.system import NodeInfo

    async def work(link: Link) -> None:
        asked = [link.platform] if link.settings.node else await platforms(link)
        ways = {route.platform: route for route in (await link.routes()).routes}
        infos, errors = await ask_all(link, asked, "sys/node/info", Empty(), NodeInfo)
        if link.settings.node and errors:
            raise errors[link.platform]
        healths, _ = await boards(link, list(infos), "health/state", HealthState)
        missions, _ = await boards(link, list(infos), "mission/state", MissionState)
        if link.settings.json:
            nodes = [
                {
                    "platform": platform,
                    "answers": platform in infos,
                    "info": infos.get(platform),
                    "route": ways.get(platform),
                    "health": healths.get(platform),
                    "mission": missions.get(platform),
                }
                for platform in asked
            ]
            link.out.document({"nodes": nodes})
        else:
            rows = []
            for platform in asked:
                info, way = infos.get(platform), ways.get(platform)
                health, mission = healths.get(platform), missions.get(platform)
                rows.append(
                    (
                        platform,
                        info.kind if info else None,
                        "answers" if info else "silent" if way else "away",
                        spoken(info.uptime_s) if info else None,
                        health.level if health else None,
                        health.battery if health and health.battery != "unknown" else None,
                        f"{mission.mission} {mission.state}".strip() if mission else None,
                        info.processes if info else None,
                        way.via if way and way.hops > 1 else None,
                        way.hops if way else 0 if platform == link.here else None,
                        info.version if info else None,
                    )
                )
            columns = [
                Column("NODE"),
                Column("KIND"),
                Column("STATE"),
                Column("UP", right=True),
                Column("HEALTH"),
                Column("BATTERY"),
                Column("MISSION"),
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
@click.argument("platform", required=False, shell_complete=completing.platforms)
@click.pass_context
def info(ctx: click.Context, platform: str | None) -> None:
    """Show one node: who it is, its services, and where its configuration is.

    Example: swarmctl node info uav1
    """
    from swarmctl.connect import Link, run
    from swarmctl.output import Column
    from swarmctl.quantities import spoken
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
            ("platform", f"{found.platform}, unit {found.unit}"),
            ("kind", f"{found.kind}, template {found.template}"),
            ("version", found.version),
            ("up", spoken(found.uptime_s)),
            ("services", ", ".join(found.services)),
            ("processes", found.processes),
            ("configuration", found.config_dir),
            ("boot", f"{found.boot_id:016x}"),
        ]
        link.out.table([Column("WHAT"), Column("IS")], rows)

    run(settings(ctx), work)
