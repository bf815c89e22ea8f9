"""Starts a mission of the swarm: plans it, asks the operator, sends the instruction, follows it."""

from typing import Final

import msgspec

from swarmctl.commandline.nodes import NodeSelection, joined
from swarmctl.commands.mission.members import follow
from swarmctl.session.session import Session
from swarmctl.terminal.confirmation import confirm
from swarmctl.terminal.table import Column
from swarmware.errors import Partial
from swarmware.types.mission import MissionPlan, MissionTask, TaskAnswer

ANSWER_S: Final = 15.0
"""Minimum time-out of the ground station, which checks the mission and sends orders to all platforms."""


async def start(
    session: Session, mission: str, task: MissionTask, members: tuple[str, ...], *, yes: bool, watch: bool
) -> None:
    """Prints the members, asks, sends the instruction; `mission`: name given by the operator.

    `members`: names and patterns of the vehicles that take part, or () for all.

    Raises: Partial when a platform refused or did not answer; with `watch` as `follow`.
    """
    if members:  # patterns are resolved here, so that the operator confirms names
        task = msgspec.structs.replace(task, members=tuple(await _members(session, members)))
    wait_s = max(session.settings.timeout_s, ANSWER_S)
    plan = await session.ask("sys/mission/plan", task, MissionPlan, timeout_s=wait_s)
    for warning in plan.warnings:
        session.out.warn(warning)
    for left in plan.left_out:
        session.out.warn(f"{left.platform}: takes no part: {left.why}")
    without = ", ".join(left.platform for left in plan.left_out)
    who = ", ".join(member.platform for member in plan.members)
    confirm(
        yes, f"start {plan.mission} with {who}{f', without {without}' if without else ''}: they will move"
    )
    answer = await session.ask("sys/mission/task", task, TaskAnswer, timeout_s=wait_s)
    if session.settings.structured and not watch:
        session.out.document(answer)
    elif not session.settings.structured:
        rows = [
            (
                order.platform,
                order.role,
                order.accepted,
                (order.acked_ns - order.sent_ns) / 1e6 if order.acked_ns else None,
                "; ".join(order.reasons) or (f"waits {order.waits}" if order.waits else ""),
            )
            for order in answer.orders
        ]
        columns = [
            Column("PLATFORM"),
            Column("ROLE"),
            Column("ACCEPTED"),
            Column("ACK ms", right=True),
            Column("REASON"),
        ]
        session.out.table(columns, rows, f"{answer.mission} {answer.hash[:8]} run {answer.epoch}")
    if not answer.accepted:
        refused = ", ".join(
            order.platform + (f" ({'; '.join(order.reasons)})" if order.reasons else "")
            for order in answer.orders
            if not order.accepted
        )
        raise Partial(f"mission {mission}: refused or not answered by {refused}; not started")
    if watch:
        took = tuple(order.platform for order in answer.orders)
        await follow(session, answer.epoch, took)


async def _members(session: Session, wanted: tuple[str, ...]) -> list[str]:
    return NodeSelection(joined(wanted)).choose(await session.platforms(), session.here)
