"""What a run knows beyond its logs: run.json of a report folder."""

import msgspec

from swarmctl.lab.host import Host
from swarmctl.lab.recording import ClockTruth
from swarmware.types.mission import OrderReceipt


class NodeFacts(msgspec.Struct, frozen=True, kw_only=True):
    """One node as the lab saw it from outside."""

    platform: str
    kind: str
    radius_m: float
    """0: no body."""
    clock: ClockTruth
    processes: str
    outcome: str
    """Newest state of its mission; empty: it had none."""
    cpu_percent: float | None = None
    """Of one core, all processes of the node, from the command to the end."""
    rss_mb: float | None = None
    """All processes of the node, at the end."""


class Facts(msgspec.Struct, frozen=True, kw_only=True):
    """One run of an experiment."""

    schema_version: int = 2
    experiment: str
    world: str
    seed: int
    net: str
    version: str
    host: Host
    started_utc_ns: int
    ready_s: float
    command_mono_ns: int
    """True time (CLOCK_MONOTONIC) at which the command was given: zero of all plots."""
    instructed_ns: int = 0
    """The same instant as the ground station stamped it, on its own hardware clock; 0: it never arrived."""
    end_mono_ns: int
    """True time at which the last platform's mission was seen to have ended."""
    completed: bool
    failure: str = ""
    """Why not."""
    orders: tuple[OrderReceipt, ...]
    nodes: tuple[NodeFacts, ...]
