"""One node: its identity as it answers, or its last known state and the reason why it does not answer."""

import msgspec

from swarmctl.resources.last_values import LastValues, last_values
from swarmctl.session.session import Session
from swarmctl.terminal.quantities import spoken
from swarmctl.terminal.table import Cell, Column
from swarmware.errors import NoAnswer
from swarmware.types.rpc import Empty
from swarmware.types.system import NodeInfo


class ShownNode(msgspec.Struct, frozen=True):
    """Identity of a node, or its last known state if it does not answer."""

    platform: str
    answers: bool
    unit: str | None = None
    """Unit of the computer, or null like all fields of the identity if the node does not answer."""
    kind: str | None = None
    template: str | None = None
    version: str | None = None
    boot_id: int | None = None
    uptime_s: float | None = None
    services: tuple[str, ...] | None = None
    config_dir: str | None = None
    processes: str | None = None
    reason: str = ""
    """Why the node does not answer, or "" if it does."""
    last: LastValues | None = None
    """Last known state, or null if the node answers."""


async def show_node(session: Session) -> None:
    """Prints the identity of a node or, if it does not answer, its last known state and the reason.

    Raises: NoAnswer in the second case; NotFound for an unknown platform.
    """
    target = session.platform
    # not `reach`: its error would end the command before the last known state is printed
    if not await session.in_reach(target):
        reason = f"node {target!r}: known, but {session.here} has no route to it now"
        await _show_lost(session, reason)
        raise NoAnswer(reason)
    try:
        found = await session.ask("sys/node/info", Empty(), NodeInfo)
    except NoAnswer as error:
        await _show_lost(session, str(error))
        raise
    if session.settings.structured:
        names = (*NodeInfo.__struct_fields__,)
        session.out.document(ShownNode(answers=True, **{name: getattr(found, name) for name in names}))
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


async def _show_lost(session: Session, reason: str) -> None:
    """Prints the last known state of a platform that does not answer."""
    values = await last_values(session, session.platform)
    if session.settings.structured:
        kind = str(values.mission.kind) if values.mission is not None and values.mission.kind else None
        session.out.document(ShownNode(values.platform, False, kind=kind, reason=reason, last=values))
        return
    if values.seen_s is None:
        return
    pose, vehicle, battery, mission = values.pose, values.vehicle, values.battery, values.mission
    rows: list[tuple[Cell, ...]] = [("platform", values.platform), ("lost", f"{spoken(values.seen_s)} ago")]
    if pose is not None:
        rows += [
            ("position", f"{pose.x_m:.1f} m east, {pose.y_m:.1f} m north"),
            # adding 0.0 turns -0.0 into 0.0
            ("height", f"{pose.z_m + 0.0:.1f} m"),
        ]
    if battery is not None:
        rows.append(("battery", f"{battery.remaining_ratio:.0%}"))
    if vehicle is not None:
        rows.append(("mode", f"{vehicle.mode}, {'armed' if vehicle.armed else 'disarmed'}"))
    if mission is not None:
        rows.append(("mission", f"{mission.mission} {mission.state}".strip()))
    session.out.table([Column("LAST KNOWN"), Column("IS")], rows)
