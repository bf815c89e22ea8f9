"""`swarmctl mission`: check, start, watch and abort missions."""

from typing import TYPE_CHECKING

import click

from swarmctl import completion
from swarmctl.lazy import Group
from swarmctl.settings import settings

if TYPE_CHECKING:
    from swarmctl.session import Session
    from swarmware.types.mission import MissionState, MissionStatus


@click.group(cls=Group)
def cmd() -> None:
    """Check, start, watch and abort missions.

    Example: swarmctl mission start formation
    """


@cmd.command()
@click.pass_context
def ls(ctx: click.Context) -> None:
    """List the missions that a ground station holds.

    Example: swarmctl mission ls
    """
    from swarmctl.output import Column
    from swarmctl.session import Session, run
    from swarmware.types.mission import MissionList
    from swarmware.types.rpc import Empty

    async def work(session: Session) -> None:
        found = await session.ask("sys/mission/ls", Empty(), MissionList)
        if session.settings.json:
            session.out.document(found)
            return
        rows = [
            (m.name, m.title, m.hash[:8], ", ".join(m.roles), m.sound, m.findings) for m in found.missions
        ]
        columns = [
            Column("MISSION"),
            Column("TITLE"),
            Column("HASH"),
            Column("ROLES"),
            Column("SOUND"),
            Column("FINDINGS", right=True),
        ]
        session.out.table(columns, rows)

    run(settings(ctx), work)


@cmd.command()
@click.argument("missions", nargs=-1, required=True, metavar="FILE|FOLDER|NAME…")
@click.pass_context
def check(ctx: click.Context, missions: tuple[str, ...]) -> None:
    """Check missions before anything moves: BDL files, mission folders, or names of shipped missions.

    Example: swarmctl mission check formation my_mission.json
    """
    from swarmctl.commands.mission.task import check_all
    from swarmctl.output import Column, Output
    from swarmware.errors import MissionError

    out = Output(settings(ctx))
    verdicts = check_all(missions)
    if settings(ctx).json:
        out.document({"missions": verdicts})
    else:
        rows = [(v.source, "sound" if v.sound else "refused", len(v.findings)) for v in verdicts]
        out.table([Column("MISSION"), Column("VERDICT"), Column("FINDINGS", right=True)], rows)
        for verdict in verdicts:
            for finding in verdict.findings:
                out.text(str(finding))
    if not all(verdict.sound for verdict in verdicts):
        bad = ", ".join(verdict.source for verdict in verdicts if not verdict.sound)
        raise MissionError(f"mission {bad}: must not be flown; expected no finding of level error")


@cmd.command()
@click.argument("mission")
@click.option(
    "--member",
    "members",
    multiple=True,
    metavar="PLATFORM",
    help="Only these take part.",
    shell_complete=completion.platforms,
)
@click.option("--set", "params", multiple=True, metavar="NAME=VALUE", help="A parameter of the mission.")
@click.option("--yes", is_flag=True, help="Do not ask; vehicles will move.")
@click.option("--watch/--no-watch", default=False, help="Follow it until it ends.")
@click.pass_context
def start(
    ctx: click.Context,
    mission: str,
    members: tuple[str, ...],
    params: tuple[str, ...],
    yes: bool,
    watch: bool,
) -> None:
    """Give the swarm one instruction: a mission by name, folder or file.

    It says what the check warns of, who would take part, which known platforms would not and why, and asks.

    Example: swarmctl mission start formation --set speed_m_s=1.0 --yes --watch
    """
    from swarmctl.commands.mission.follow import follow
    from swarmctl.commands.mission.task import task
    from swarmctl.confirmation import confirm
    from swarmctl.output import Column
    from swarmctl.session import Session, run
    from swarmware.errors import Partial
    from swarmware.types.mission import MissionPlan, TaskAnswer

    wish = task(mission, members, params)

    async def work(session: Session) -> None:
        plan = await session.ask(
            "sys/mission/plan", wish, MissionPlan, timeout_s=max(session.settings.timeout_s, 15.0)
        )
        for warning in plan.warnings:
            session.out.warn(warning)
        for left in plan.left_out:
            session.out.warn(f"{left.platform}: takes no part: {left.why}")
        without = ", ".join(left.platform for left in plan.left_out)
        who = ", ".join(member.platform for member in plan.members)
        confirm(
            yes, f"start {plan.mission} with {who}{f', without {without}' if without else ''}: they will move"
        )
        answer = await session.ask(
            "sys/mission/task", wish, TaskAnswer, timeout_s=max(session.settings.timeout_s, 15.0)
        )
        if session.settings.json and not watch:
            session.out.document(answer)
        elif not session.settings.json:
            rows = [
                (
                    order.platform,
                    order.role,
                    order.accepted,
                    (order.acked_ns - order.sent_ns) / 1e6 if order.acked_ns else None,
                    "; ".join(order.reasons),
                )
                for order in answer.orders
            ]
            columns = [
                Column("PLATFORM"),
                Column("ROLE"),
                Column("ACCEPTED"),
                Column("ACK ms", right=True),
                Column("WHY NOT"),
            ]
            session.out.table(columns, rows, f"{answer.mission} {answer.hash[:8]} run {answer.epoch}")
        if not answer.accepted:
            refused = ", ".join(order.platform for order in answer.orders if not order.accepted)
            raise Partial(f"mission {mission}: refused or not heard by {refused}; nobody started")
        if watch:
            took = tuple(order.platform for order in answer.orders)
            await follow(session, answer.epoch, took)

    run(settings(ctx), work)


@cmd.command()
@click.pass_context
def status(ctx: click.Context) -> None:
    """Show what the mission of a platform, and of the members it hears, does now.

    Example: swarmctl mission status --json
    """
    from swarmctl.session import Session, run
    from swarmware.types.mission import MissionStatus
    from swarmware.types.rpc import Empty

    async def work(session: Session) -> None:
        found = await session.ask("sys/mission/status", Empty(), MissionStatus)
        if session.settings.json:
            session.out.document(found)
        else:
            _show(session, found)

    run(settings(ctx), work)


@cmd.command()
@click.argument("platforms", nargs=-1, metavar="[PLATFORM…]", shell_complete=completion.platforms)
@click.pass_context
def watch(ctx: click.Context, platforms: tuple[str, ...]) -> None:
    """Follow a mission until it ends, a line for each change of a member, or of the members that are named.

    Example: swarmctl mission watch --json
    """
    from swarmctl.commands.mission.follow import find_active, follow
    from swarmctl.session import Session, run
    from swarmware.errors import NotFound

    async def work(session: Session) -> None:
        found = await find_active(session)
        if strangers := [name for name in platforms if name not in found.members]:
            members = ", ".join(found.members)
            raise NotFound(f"{strangers[0]}: no member of {found.mission}; expected some of {members}")
        await follow(session, found.epoch, platforms or found.members)

    run(settings(ctx), work)


@cmd.command()
@click.argument("platforms", nargs=-1, metavar="[PLATFORM…]", shell_complete=completion.platforms)
@click.option("--reason", default="operator", help="Why; it stands in every log.")
@click.option(
    "--then", type=click.Choice(["land", "hold", "return"]), default="land", help="What takes over."
)
@click.option("--yes", is_flag=True, help="Do not ask.")
@click.option(
    "--timeout",
    "wait_s",
    metavar="SECONDS",
    type=click.FloatRange(min=0, min_open=True),
    default=120.0,
    help="Longest wait until it is seen to be done; default: 120.",
)
@click.pass_context
def abort(
    ctx: click.Context, platforms: tuple[str, ...], reason: str, then: str, yes: bool, wait_s: float
) -> None:
    """Stop the running mission at all its members, or only at those that are named (also by -n).

    It follows them until each was seen to land, to hold or to return.

    Example: swarmctl mission abort --then hold --yes
    """
    from swarmctl.commands.mission.follow import find_active
    from swarmctl.confirmation import confirm
    from swarmctl.manoeuvres import manoeuvre
    from swarmctl.session import Session, run
    from swarmctl.vehicle_observer import raise_failures
    from swarmctl.vehicles import choose, is_station
    from swarmware.errors import NotFound
    from swarmware.types.mission import MissionAbort

    async def work(session: Session) -> None:
        one = session.settings.node and not await is_station(session, session.settings.node)
        if platforms or one:
            chosen = await choose(session, platforms)
            said = f"abort the mission at {', '.join(chosen)} alone, then {then}; where others wait for it"
            confirm(yes, f"{said} they take their alternative")
        else:
            found = await find_active(session)
            if not found.plays:
                raise NotFound(
                    f"no mission runs at {', '.join(found.members)}; expected one"
                    " (`swarmctl land --all` lands whatever flies)"
                )
            chosen = {name: found.kinds[name] for name in found.members}
            confirm(yes, f"abort {found.mission} at {', '.join(chosen)}, then {then}")
        seen = await manoeuvre(session, MissionAbort(reason, then), chosen, wait_s)
        if session.settings.json:
            told = [one.platform for one in seen if one.reached]
            silent = [one.platform for one in seen if not one.reached]
            session.out.document({"told": told, "silent": silent, "vehicles": seen})
        raise_failures("abort", seen)

    run(settings(ctx), work)


def _rows(found: "MissionStatus") -> "list[tuple[str, MissionState]]":
    from swarmware import names

    states = {found.platform: found.state, **found.others}
    return sorted(states.items(), key=lambda item: names.natural(item[0]))


def _show(session: "Session", found: "MissionStatus") -> None:
    from swarmctl.output import Column

    rows = [
        (
            platform,
            state.mission,
            state.state,
            f"{state.progress_ratio * 100:.0f} %",
            ", ".join(state.active),
            ", ".join(arrival.barrier for arrival in state.arrivals),
            state.text,
        )
        for platform, state in _rows(found)
    ]
    columns = [
        Column("PLATFORM"),
        Column("MISSION"),
        Column("STATE"),
        Column("PROGRESS", right=True),
        Column("BLOCKS"),
        Column("WAITS AT"),
        Column("SAYS"),
    ]
    session.out.table(columns, rows)
