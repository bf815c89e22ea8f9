"""Data of a run that its logs do not have: run.json of a report folder."""

from collections.abc import Iterable

import msgspec

from swarmlab.measure.clocks import ClockTruth
from swarmlab.measure.host import HostInfo
from swarmlab.run.notify import Restarts
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import OrderReceipt


class NodeMetadata(msgspec.Struct, frozen=True, kw_only=True):
    """One node as observed by the lab."""

    platform: str
    kind: PlatformKind
    radius_m: float
    """Radius of the vehicle, or 0 for other platforms."""
    clock: ClockTruth
    processes: str
    outcome: str
    """Newest state of the platform's mission, or "" without one."""
    restarts: Restarts = Restarts()
    """Restarts of its process by its supervisor."""
    ended: str = ""
    """How the node ended before the end of the run, or "" if it did not."""
    log: str = ""
    """Path of its processes' output in the report folder."""
    cpu_percent: float | None = None
    """Processor time of all its processes from the command to the end, in percent of one core."""
    rss_mb: float | None = None
    """Resident memory of all its processes at the end (RSS): shared pages count in each."""
    pss_mb: float | None = None
    """The same with shared pages divided among those who share them (PSS)."""


class RunMetadata(msgspec.Struct, frozen=True, kw_only=True):
    """One run of an experiment."""

    schema_version: int = 2
    experiment: str
    world: str
    seed: int
    net: str
    version: str
    commit: str = ""
    """Git commit of the sources, with -dirty if files differ from it, or "" outside a checkout."""
    versions: dict[str, str] = {}
    """Versions of Python and the libraries."""
    command: str = ""
    """The command that repeats the run."""
    host: HostInfo
    started_utc_ns: int
    ready_s: float
    command_mono_ns: int
    """True time (CLOCK_MONOTONIC) at which the command was given: zero of all plots."""
    instructed_ns: int = 0
    """Stamp of the command on the ground station's hardware clock, or 0 if it never arrived."""
    end_mono_ns: int
    """True time at which the last platform's mission was seen to have ended."""
    completed: bool
    failure: str = ""
    """Why the mission was not completed, or "" if it was."""
    orders: tuple[OrderReceipt, ...]
    nodes: tuple[NodeMetadata, ...]

    def remarks(self) -> list[str]:
        """Failures, each as a sentence: the failure, then nodes that were restarted."""
        restarted = [
            f"node {node.platform}: {node.restarts}; {node.log}" for node in self.nodes if node.restarts.count
        ]
        return [*([self.failure] if self.failure else []), *restarted]


def failure(nodes: Iterable[NodeMetadata], course: str) -> str:
    """Why a mission was not completed: nodes that ended, else the observed failure."""
    # the end of a node is the cause, what its mission lacked afterwards the effect
    ended = [f"node {node.platform}: ended with {node.ended}; {node.log}" for node in nodes if node.ended]
    return ", ".join(ended) or course
