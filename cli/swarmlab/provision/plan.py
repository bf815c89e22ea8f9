"""The nodes of a lab: names, kinds and simulated clocks, from the number of nodes and a seed."""

import random
from collections.abc import Collection, Sequence
from typing import Final

import msgspec

from swarmware.errors import InvalidInput
from swarmware.model.names import MAIN, Address
from swarmware.model.platform_kind import PlatformKind

MIN_NODES: Final = 3
"""Minimum: a ground station, a ground vehicle as leader, and an air vehicle."""
MAX_NODES: Final = 200
"""Larger swarms are simulated in virtual time."""
OFFSET_S: Final = 5.0
"""Maximum offset of simulated clocks from true time."""
DRIFT_PPM: Final = 50.0
"""Maximum drift of simulated clocks, typical of an uncompensated quartz."""


class PlannedNode(msgspec.Struct, frozen=True):
    """One node of a lab that is planned."""

    platform: str
    kind: PlatformKind
    """ugv | usv | uav | gcs."""
    offset_s: float
    drift_ppm: float


def kinds(nodes: int, usv: int = 0) -> tuple[int, int]:
    """Numbers of ground and air vehicles: about one to two, besides the ground station (S0.75: 5 + 10 + 1)
    and the surface vessels.

    Raises: InvalidInput when the number is out of range.
    """
    if not MIN_NODES <= nodes <= MAX_NODES:
        raise InvalidInput(f"number of nodes {nodes}: expected {MIN_NODES}..{MAX_NODES}")
    if not 0 <= usv <= nodes - MIN_NODES:
        raise InvalidInput(
            f"number of surface vessels {usv}: expected 0..{nodes - MIN_NODES} of {nodes} nodes"
        )
    vehicles = nodes - 1 - usv
    ground = max(1, round(vehicles / 3))
    return ground, vehicles - ground


def members(nodes: int, seed: int, usv: int = 0) -> tuple[PlannedNode, ...]:
    """The nodes, ground station first, each with another clock.

    Raises: InvalidInput when the number is out of range.
    """
    ground, air = kinds(nodes, usv)
    who = [("gcs", PlatformKind.GCS)]
    who += [(f"ugv{i}", PlatformKind.UGV) for i in range(1, ground + 1)]
    who += [(f"usv{i}", PlatformKind.USV) for i in range(1, usv + 1)]
    who += [(f"uav{i}", PlatformKind.UAV) for i in range(1, air + 1)]
    chance = random.Random(seed)
    return tuple(PlannedNode(platform, kind, *_clock(chance)) for platform, kind in who)


def clock_of(member: PlannedNode, unit: str, seed: int) -> tuple[float, float]:
    """Offset in s and drift in ppm of the clock of one computer of a platform."""
    if unit == MAIN:
        return member.offset_s, member.drift_ppm
    # a generator of its own: distributing a vehicle does not change the clocks of the others
    return _clock(random.Random(f"clock {seed} {Address(member.platform, unit)}"))


def _clock(chance: random.Random) -> tuple[float, float]:
    return (
        round(chance.uniform(-OFFSET_S, OFFSET_S), 6),
        round(chance.uniform(-DRIFT_PPM, DRIFT_PPM), 3),
    )


def per_daemon(spec: str | None, who: tuple[PlannedNode, ...]) -> frozenset[str]:
    """Platforms whose services get a process each: none, `all`, or those named.

    Raises: InvalidInput when a name is not a node of the lab.
    """
    if spec is None:
        return frozenset()
    return _named("--per-daemon", spec, {member.platform for member in who})


def _named(option: str, spec: str, known: set[str]) -> frozenset[str]:
    if spec in {"", "all"}:
        return frozenset(known)
    named = {name.strip() for name in spec.split(",") if name.strip()}
    if unknown := sorted(named - known):
        raise InvalidInput(
            f"{option} {unknown[0]}: no such node; expected some of {', '.join(sorted(known))}"
        )
    return frozenset(named)


UNITS: Final = ("main", "nav", "fc")
"""Computers of a distributed vehicle: mission; estimator; controller, devices and motors."""


def distributed(spec: str | None, who: tuple[PlannedNode, ...]) -> frozenset[str]:
    """Vehicles whose services are distributed over several computers: none, `all`, or those named.

    Raises: InvalidInput when a name is not a vehicle of the lab.
    """
    if spec is None:
        return frozenset()
    known = {member.platform for member in who if member.kind is not PlatformKind.GCS}
    return _named("--units", spec, known)


def airframes(specs: Sequence[str], who: tuple[PlannedNode, ...]) -> dict[str, str]:
    """Airframe by air vehicle, from `AIRFRAME` (of all) or `NAMES=AIRFRAME`; the later one counts.

    Raises: InvalidInput when a name is not an air vehicle of the lab.
    """
    known = {member.platform for member in who if member.kind is PlatformKind.UAV}
    found: dict[str, str] = {}
    for spec in specs:
        names, _, airframe = spec.rpartition("=")
        found |= dict.fromkeys(_named("--airframe", names, known), airframe)
    return found


def extra_services(named: Sequence[str], usual: Collection[str]) -> tuple[str, ...]:
    """Services of every node beside the usual ones, each once.

    Raises: InvalidInput for a name that is not installed.
    """
    if not named:
        return ()
    from swarmware.service.installed import installed  # most labs have the usual services alone

    for name in named:
        if name not in installed():
            further = ", ".join(sorted(installed().keys() - usual))
            raise InvalidInput(f"--service {name}: not installed; expected one of {further}")
    return tuple(name for name in dict.fromkeys(named) if name not in usual)


def start_order(platforms: Sequence[str], seed: int) -> list[str]:
    """Platforms in a random order: no node may depend on the order of starts (S0.37)."""
    names = list(platforms)
    random.Random(f"order {seed}").shuffle(names)
    return names
