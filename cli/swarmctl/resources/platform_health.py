"""Health of platforms; a platform with several computers is as healthy as its worst computer."""

import asyncio
from collections.abc import Mapping
from typing import Final

from swarmctl.resources.fanout import read_boards
from swarmctl.session.session import Session
from swarmware.errors import SwarmError
from swarmware.model.names import Address
from swarmware.types.health import WORSE, HealthState

PATH: Final = "health/state"
GUARDS: Final = {"alive": 0, "absent": 1, "hung": 2}
BATTERIES: Final = {"unknown": 0, "ok": 1, "low": 2, "critical": 3}
FAULTS_SHOWN: Final = 16
"""Maximum faults that a state names, the same as for one computer."""


async def platform_health(
    session: Session, asked: list[str]
) -> tuple[dict[str, HealthState], dict[str, SwarmError]]:
    """The state of each platform, merged over its computers; and the errors of those without an answer.

    A computer of a platform that has a route and does not answer is a fault of the platform.
    """
    units: dict[str, set[str]] = {}
    for route in (await session.routes()).routes:
        units.setdefault(route.platform, set()).add(route.unit)
    # no route leads to the computer itself
    own = session.module.node.address
    units.setdefault(own.platform, set()).add(own.unit)
    several = {name: sorted(units[name]) for name in asked if len(units.get(name, ())) > 1}
    single = [name for name in asked if name not in several]
    computers = [Address(name, unit).path for name, found in several.items() for unit in found]
    (states, errors), (of_computers, silent) = await asyncio.gather(
        read_boards(session, single, PATH, HealthState), read_boards(session, computers, PATH, HealthState)
    )
    for name, found in several.items():
        answers = {unit: of_computers.get(Address(name, unit).path) for unit in found}
        # a single computer that answers shows that the platform exists; the silent ones become its faults
        if any(answers.values()):
            states[name] = merged(answers)
        else:
            errors[name] = silent[Address(name, found[0]).path]
    return states, errors


def merged(units: Mapping[str, HealthState | None]) -> HealthState:
    """The state of a platform, merged from its computers' states, each None if it did not answer.

    Faults are named by unit: `fc: app/hal=died`.
    """
    states = {unit: state for unit, state in units.items() if state is not None}
    worst = sorted(states.items(), key=lambda one: -_rank(WORSE, one[1].level))
    lost = tuple(f"{unit}: no answer" for unit in units if unit not in states)
    faults = lost + tuple(f"{unit}: {fault}" for unit, state in worst for fault in state.faults)
    charged = min(
        states.values(),
        key=lambda state: (-_rank(BATTERIES, state.battery), state.battery_ratio),
    )
    return HealthState(
        level="error" if lost else worst[0][1].level,
        battery=charged.battery,
        battery_ratio=charged.battery_ratio,
        sensors={path: good for state in states.values() for path, good in state.sensors.items()},
        # lost computers are first, so the cut never hides them
        faults=faults[:FAULTS_SHOWN],
        fault_count=len(lost) + sum(state.fault_count for state in states.values()),
        checks=sum(state.checks for state in states.values()),
        apps_alive=sum(state.apps_alive for state in states.values()),
        apps_failed=sum(state.apps_failed for state in states.values()),
        guard=max((state.guard for state in states.values()), key=lambda guard: _rank(GUARDS, guard)),
    )


def _rank(order: Mapping[str, int], name: str) -> int:
    """Place in the order; an unknown name ranks as the worst."""
    return order.get(name, len(order))
