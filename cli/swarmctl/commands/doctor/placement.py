"""`swarmctl doctor placement`: measures and judges where the applications of a platform run."""

import asyncio
from typing import Final

import msgspec

from swarmctl.commands.doctor.placement_verdict import InputVerdict, PlacementReport, judge
from swarmctl.resources.fanout import read_boards
from swarmctl.session.session import Session
from swarmctl.terminal.table import Cell, Column, Detail, rows_of
from swarmware.errors import NoAnswer, SwarmError
from swarmware.model import names
from swarmware.model.names import MAIN, Address
from swarmware.types.driver import DriverTable
from swarmware.types.placement import PlacementRequest, UnitPlacement

WINDOW_S: Final = 3.0
"""Time of the measurement: some values also of resources with 1 Hz."""
OBJECTIONS: Final = 1
"""Exit code when an application should be placed elsewhere."""


class Placements(msgspec.Struct, frozen=True):
    """Placement of the applications of platforms."""

    platforms: list[PlacementReport]


async def show_placement(session: Session, link_mbit_s: float | None) -> int:
    """Prints the verdicts on the selected platforms, else on all; returns the exit code.

    Raises: NoAnswer when no computer of any of them answers.
    """
    units: dict[str, list[str]] = {}
    for route in (await session.routes()).routes:
        units.setdefault(route.platform, []).append(route.unit)
    # no route leads to the computer itself
    units.setdefault(session.here, []).append(session.module.node.address.unit)
    asked = await session.selected()
    for name in asked:
        await session.reach(name)
    stated_bit_s = None if link_mbit_s is None else link_mbit_s * 1e6
    found = await asyncio.gather(
        *(_measured(session, name, sorted(units[name], key=_main_first), stated_bit_s) for name in asked)
    )
    reports = [report for report in found if report.units]
    if not reports:
        raise NoAnswer(
            f"{', '.join(asked)}: no computer measures its placement; expected an answer of its tree"
        )
    if session.settings.structured:
        session.out.document(Placements(reports))
    else:
        _show(session, reports)
    for report in found:
        for unit in report.silent:
            session.out.warn(f"{report.platform}.{unit}: no answer; its applications are not judged")
    return OBJECTIONS if any(report.objections for report in reports) else 0


def _main_first(unit: str) -> tuple[bool, str]:
    return unit != MAIN, unit


async def _measured(
    session: Session, platform: str, units: list[str], stated_bit_s: float | None
) -> PlacementReport:
    async def one(unit: str) -> UnitPlacement | None:
        path = names.join(Address(platform, unit).path, "sys/tree/placement")
        # the answer comes after the window of the measurement
        wait_s = WINDOW_S + session.settings.timeout_s
        try:
            return await session.module.request(
                path, PlacementRequest(WINDOW_S), UnitPlacement, timeout_s=wait_s
            )
        except SwarmError:
            return None

    (boards, _), answers = await asyncio.gather(
        read_boards(session, [platform], "hal/drivers", DriverTable),
        asyncio.gather(*(one(unit) for unit in units)),
    )
    silent = [unit for unit, answer in zip(units, answers, strict=True) if answer is None]
    lines = boards[platform].lines if platform in boards else ()
    found = [answer for answer in answers if answer is not None]
    return judge(platform, found, stated_bit_s, silent, lines)


def _show(session: Session, reports: list[PlacementReport]) -> None:
    out = session.out
    rows: list[tuple[Cell, ...]] = [
        (
            f"{report.platform}.{load.unit}",
            load.cores,
            f"{load.busy_percent:.0f}",
            f"{load.free_percent:.0f}",
            None if load.communication_percent is None else f"{load.communication_percent:.1f}",
            load.interfaces,
            "over" if load.over_capacity else "ok",
        )
        for report in reports
        for load in report.units
    ]
    columns = [
        Column("COMPUTER"),
        Column("CORES", right=True),
        Column("BUSY %", right=True),
        Column("FREE %", right=True),
        Column("COMMUNICATION %", right=True),
        Column("INTERFACES", right=True),
        Column("CAPACITY"),
    ]
    out.table(columns, rows)
    inputs: list[Detail[InputVerdict]] = [
        Detail("INPUT", value=lambda one: one.path),
        Detail("FROM", value=lambda one: one.unit),
        Detail("READ BY", value=lambda one: " ".join(one.applications), wraps=True),
        Detail("MEAN ms", value=lambda one: _ms(one.delay_mean_ms), right=True, drop=1),
        Detail("P95 ms", value=lambda one: _ms(one.delay_p95_ms), right=True),
        Detail("WORST ms", value=lambda one: _ms(one.delay_worst_ms), right=True, drop=2),
        Detail("NEEDED ms", value=lambda one: _ms(one.needed_ms), right=True),
        Detail("B/s", value=lambda one: f"{one.bytes_s:.0f}", right=True),
        Detail(
            "DELAY", value=lambda one: "late" if one.late else "ok" if one.needed_ms else "no need stated"
        ),
    ]
    if found := [one for report in reports for one in report.inputs]:
        out.table(inputs, rows_of(inputs, found))
    links: list[tuple[Cell, ...]] = [
        (
            f"{report.platform}.{link.sender}",
            f"{report.platform}.{link.receiver}",
            f"{link.bytes_s * 8 / 1e3:.1f}",
            f"{link.rate_bit_s / 1e3:.0f}" if link.rate_bit_s else "unknown",
            "over" if link.exceeded else "ok" if link.rate_bit_s else "not judged",
        )
        for report in reports
        for link in report.links
    ]
    if links:
        out.table(
            [
                Column("FROM"),
                Column("TO"),
                Column("SENT kbit/s", right=True),
                Column("RATE kbit/s", right=True),
                Column("CAPACITY"),
            ],
            links,
        )
    lines: list[tuple[Cell, ...]] = [
        (
            report.platform,
            line.device,
            " ".join(line.drivers),
            f"{line.asked_bit_s / 1e3:.1f}",
            f"{line.capacity_bit_s / 1e3:.1f}" if line.capacity_bit_s else None,
            "over" if line.over_capacity else "ok",
        )
        for report in reports
        for line in report.lines
    ]
    if lines:
        out.table(
            [
                Column("PLATFORM"),
                Column("LINE"),
                Column("DRIVERS", wraps=True),
                Column("ASKED kbit/s", right=True),
                Column("CARRIES kbit/s", right=True),
                Column("CAPACITY"),
            ],
            lines,
        )
    verdicts: list[tuple[Cell, ...]] = [
        (f"{report.platform}.{one.unit}", one.application, one.verdict, one.reason)
        for report in reports
        for one in report.modules
    ]
    out.table(
        [Column("COMPUTER"), Column("APPLICATION"), Column("VERDICT"), Column("REASON", wraps=True)],
        verdicts,
        empty="no application beside those that each computer has",
    )
    for report in reports:
        if len(report.units) + len(report.silent) == 1:
            out.say(f"{report.platform} has one computer: nothing is separated, only its load is judged")


def _ms(value: float | None) -> str | None:
    return None if value is None else f"{value:.1f}"
