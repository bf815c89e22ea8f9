"""Requests for takeoff and goto, from the names of vehicles to the observed results."""

import asyncio
from collections.abc import Mapping
from typing import Final

import click

from swarmctl.session.session import Session
from swarmctl.terminal.confirmation import confirm
from swarmctl.vehicles.manoeuvre import request
from swarmctl.vehicles.observer import VehicleObserver
from swarmctl.vehicles.selection import choose
from swarmctl.vehicles.snapshot import arrived_at, risen_to
from swarmware.errors import InvalidInput, NoAnswer
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import ManoeuvreRequest
from swarmware.types.vehicle import Pose

POSE_S: Final = 5.0
"""Longest wait for the position of a vehicle."""


async def take_off(
    session: Session,
    wanted: tuple[str, ...],
    altitude_m: float,
    speed_m_s: float,
    reason: str,
    wait_s: float,
    *,
    yes: bool,
    force: bool = False,
) -> None:
    """`swarmctl takeoff`: of the chosen vehicles those that fly; `force`: also those not ready.

    Raises: as `choose` and `request`; InvalidInput when none of them flies, UsageError without confirmation.
    """
    chosen = await choose(session, wanted)
    flying = {name: kind for name, kind in chosen.items() if kind == PlatformKind.UAV}
    if not flying:
        raise InvalidInput(f"takeoff: {', '.join(chosen)}: does not fly; expected a vehicle of kind uav")
    if len(flying) > 1:
        confirm(yes, f"take off {', '.join(flying)}: motors turn")
    params = {"altitude_m": altitude_m, "speed_m_s": speed_m_s}
    orders = dict.fromkeys(flying, ManoeuvreRequest("takeoff", params, reason, force))
    await request(session, orders, flying, dict.fromkeys(flying, risen_to(altitude_m)), wait_s)


async def go_to(
    session: Session,
    wanted: tuple[str, ...],
    to: tuple[float, ...] | None,
    by: tuple[float, ...] | None,
    speed_m_s: float,
    reason: str,
    wait_s: float,
) -> None:
    """`swarmctl goto`: to a place, or by a displacement.

    Raises: as `choose` and `request`; UsageError for one place of several vehicles, NoAnswer without a pose.
    """
    chosen = await choose(session, wanted)
    if to is not None and len(chosen) > 1:
        raise click.UsageError(f"--to: {', '.join(chosen)} would meet at one place; expected one, or --by")
    poses = await _poses(session, chosen) if by is not None else {}
    orders, done = {}, {}
    for name, kind in chosen.items():
        x_m, y_m, *height = _place(poses[name], by) if by is not None else to or ()
        z_m = height[0] if height and kind == PlatformKind.UAV else None
        params = {"x_m": x_m, "y_m": y_m, "speed_m_s": speed_m_s}
        orders[name] = ManoeuvreRequest("goto", params if z_m is None else params | {"z_m": z_m}, reason)
        done[name] = arrived_at(x_m, y_m, z_m)
    await request(session, orders, chosen, done, wait_s)


def _place(pose: Pose, by: tuple[float, ...]) -> tuple[float, ...]:
    here = (pose.x_m, pose.y_m, pose.z_m)
    return tuple(start + step for start, step in zip(here, by, strict=False))


async def _poses(session: Session, chosen: Mapping[str, PlatformKind]) -> dict[str, Pose]:
    """Present positions of the vehicles."""
    observer = VehicleObserver(session, chosen)
    found: dict[str, Pose] = {}
    try:
        async with asyncio.timeout(POSE_S):
            while len(found) < len(chosen):
                for name in chosen:
                    if (pose := observer.snapshot(name).pose) is not None:
                        found[name] = pose
                if len(found) < len(chosen):
                    await observer.changed()
    except TimeoutError:
        missing = ", ".join(name for name in chosen if name not in found)
        raise NoAnswer(f"goto: the position of {missing} is not known; expected nav/pose") from None
    return found
