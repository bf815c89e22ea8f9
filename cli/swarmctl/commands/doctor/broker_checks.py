"""Checks of the broker's counters, read from its board without joining the node."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.commands.doctor.check_result import CheckResult
from swarmware.errors import SwarmError
from swarmware.model.frame import decode
from swarmware.transport.security.keys import FORMER_MAX
from swarmware.transport.shm.layout import ring_file
from swarmware.transport.shm.ring import RingReader  # noqa: TID251  # read once, without the node
from swarmware.types import registry
from swarmware.types.traffic import CERTAINLY_HOSTILE, HOSTILE, Traffic

MISSED: Final = (
    "a member with an old roster joins again: `swarmctl keys invite`, then `swarmctl keys join --replace`"
)


def hostile_input(shm_dir: Path) -> Iterator[CheckResult]:
    """Input that the broker refused and no valid member sends, beside what `foreign` reports."""
    try:
        traffic = _traffic(shm_dir)
    except SwarmError:
        return  # `processor` reports a board that cannot be read
    if traffic is None:
        return
    counts = msgspec.structs.asdict(traffic.refused)
    # an own result, since it happens to valid members after a restart
    if traffic.refused.undated:
        text = f"{traffic.refused.undated} commands came before the first beacon of their sender"
        yield CheckResult("undated", "ok", f"{text}, which repeats them")
    found = ", ".join(f"{counts[name]} {name}" for name in HOSTILE if counts[name])
    # the other counters also rise by loss and repetition
    if not any(counts[name] for name in CERTAINLY_HOSTILE):
        yield CheckResult("refused", "ok", found or "no forged or repeated input")
        return
    advice = "swarmctl log shows the platforms; revoke a member that does this, block outsiders by a firewall"
    yield CheckResult("refused", "warning", found, advice)


def processor(shm_dir: Path) -> CheckResult:
    """Whether the broker sends its beacons in time, from its board `net/traffic`."""
    try:
        traffic = _traffic(shm_dir)
    except SwarmError as error:
        return CheckResult(
            "processor", "warning", f"net/traffic cannot be read: {error}", "swarmctl traffic ls"
        )
    if traffic is None:
        return CheckResult("processor", "ok", "the broker has just started")
    if traffic.slowdown > 1:
        text = (
            f"processor overloaded: beacons {traffic.slowdown:g} times rarer ({traffic.slowed_ticks} so far)"
        )
        return CheckResult("processor", "warning", text, "run fewer services or nodes on this computer")
    return CheckResult(
        "processor", "ok", f"{traffic.tick_hz:g} beacons a second, {traffic.slowed_ticks} delayed so far"
    )


def foreign(shm_dir: Path) -> Iterator[CheckResult]:
    """Whether nodes with keys of another swarm are in reach, from the broker's board `net/traffic`."""
    try:
        traffic = _traffic(shm_dir)
    except SwarmError:
        return  # `processor` reports a board that cannot be read
    if traffic is None:
        return
    refused = traffic.refused
    if refused.forged:
        text = (
            f"{refused.forged} datagrams that no member has sealed, and that name no other swarm: forged, or"
            f" of a member that missed more than {FORMER_MAX} changes of the group key"
        )
        yield CheckResult("keys", "warning", text, f"block outsiders by a firewall; {MISSED}")
    for other in traffic.other_swarms:
        what = f"another swarm, root {other.root}…" if other.root else "nodes without keys"
        text = f"{what}, on this network: {other.datagrams} datagrams from {', '.join(other.addresses)}"
        advice = (
            "where a node there belongs to this swarm, compare `root` of `swarmctl keys show`, then `swarmctl"
            " keys invite` here and `swarmctl keys join --replace` there; otherwise give one swarm another"
            " udp_port or multicast_group in broker.toml"
        )
        yield CheckResult("keys", "warning", text, advice)
    if refused.other_epoch:
        text = (
            f"{refused.other_epoch} datagrams with a group key that is not known here: normal for seconds"
            f" after a change; if they continue, this node or their sender missed more than {FORMER_MAX}:"
            f" {MISSED}"
        )
        yield CheckResult("keys", "ok", text)


def _traffic(shm_dir: Path) -> Traffic | None:
    """The counters of the broker, or None before the first. Raises: SwarmError when they cannot be read."""
    with contextlib.closing(RingReader(ring_file(shm_dir, "net/traffic"))) as ring:
        data = ring.newest()
    if data is None:
        return None
    frame = decode(data)
    return registry.decode(Traffic, frame.payload, frame.codec)
