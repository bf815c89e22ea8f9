"""The last values of a lost platform that the joined node received."""

import asyncio
from typing import Final, TypeVar

import msgspec

from swarmctl.resources.newest import newest
from swarmctl.session.session import Session
from swarmware.errors import SwarmError
from swarmware.model import names
from swarmware.types import registry
from swarmware.types.mission import MissionState
from swarmware.types.net import Neighbours
from swarmware.types.rpc import Empty
from swarmware.types.tree import TreeValue
from swarmware.types.vehicle import BatteryState, Pose, VehicleState

T = TypeVar("T", bound=msgspec.Struct)

KEPT: Final = {
    "mission/state": MissionState,
    "vehicle/state": VehicleState,
    "nav/pose": Pose,
    "power/battery": BatteryState,
}
"""Boards of other platforms that a ground station keeps (`keep` of services/tree.toml)."""


class LastValues(msgspec.Struct, frozen=True):
    """Last known state of a platform without a route."""

    platform: str
    seen_s: float | None
    """Age of the newest datagram received here or of the newest of these values, or None if unknown."""
    mission: MissionState | None
    vehicle: VehicleState | None
    pose: Pose | None
    battery: BatteryState | None


async def last_values(session: Session, platform: str) -> LastValues:
    """Last values of a platform, each None if it was never received here."""

    async def one(path: str) -> TreeValue | None:
        try:
            return await newest(session, names.join(platform, path))
        except SwarmError:
            return None  # never received, or not a vehicle

    silent_s, values = await asyncio.gather(_silent_s(session, platform), asyncio.gather(*map(one, KEPT)))
    found = dict(zip(KEPT, values, strict=True))
    # a vehicle at rest publishes nothing for a long time but sends beacons, so they count as well
    ages = [value.age_s for value in values if value is not None and value.age_s is not None]
    ages += [] if silent_s is None else [silent_s]

    def decoded(path: str, cls: type[T]) -> T | None:
        value = found[path]
        return None if value is None else registry.decode(cls, value.data)

    return LastValues(
        platform,
        min(ages, default=None),
        decoded("mission/state", MissionState),
        decoded("vehicle/state", VehicleState),
        decoded("nav/pose", Pose),
        decoded("power/battery", BatteryState),
    )


async def _silent_s(session: Session, platform: str) -> float | None:
    """Age of the newest datagram from any computer of a platform, or None without a recent one."""
    try:
        path = names.join(session.here, "sys/broker/links")
        found = await session.ask(path, Empty(), Neighbours)
    except SwarmError:
        return None
    return min((one.silent_s for one in found.neighbours if one.platform == platform), default=None)
