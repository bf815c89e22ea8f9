"""The experiment `distribution`: a mission with the services of a vehicle on one computer, and on three."""

from collections.abc import Iterable
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Column
from swarmlab import experiment
from swarmlab.measure.clocks import ClockTruth
from swarmlab.measure.path_difference import Flown, PathDifference, difference
from swarmlab.measure.recording import TRUTH, Recording
from swarmlab.measure.tracks import Floats, VehicleTrack
from swarmlab.provision import prerequisites
from swarmlab.provision.provisioning import LabSpec
from swarmlab.run.mission_run import MissionRun
from swarmlab.run.running import RunningLab
from swarmware.errors import SwarmError
from swarmware.model.names import MAIN, Address
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionState
from swarmware.types.vehicle import Collision

MISSION: Final = "formation"
DISTRIBUTED: Final = "uav1"
DELAY_MS: Final = (2.0, 8.0)
"""Delay between the computers, as in the original experiment (S1.80)."""
GOAL_M: Final = 0.2
"""Largest root mean square of the distance of both paths in space.

That at the same time is not judged: a follower is where its leader is, which no two runs drive equally.
"""
COLLISION: Final = "sim/collision"
STATE: Final = "mission/state"
REPORT: Final = "distribution.json"
PICTURE: Final = "distribution.png"
HARDWARE: Final = "fc"
"""Computer whose log has the true path of a distributed vehicle; that of `main` has its mission."""


class VehicleDifference(msgspec.Struct, frozen=True):
    """Difference of the two paths of one vehicle."""

    platform: str
    units: tuple[str, ...]
    """Its computers in the second run."""
    difference: PathDifference | None
    """Null: a path is missing."""
    collisions: tuple[int, int]
    """Collisions in the first and the second run."""


class DistributionReport(msgspec.Struct, frozen=True):
    """Comparison of a mission with the services of a vehicle on one computer and on three."""

    delay_ms: tuple[float, float]
    goal_m: float
    vehicles: tuple[VehicleDifference, ...]
    failures: tuple[str, ...] = ()
    """Why a run was not completed."""

    def misses(self) -> list[str]:
        """Goals that were not reached."""
        out = list(self.failures)
        for one in self.vehicles:
            if one.difference is None:
                out.append(f"{one.platform}: a path is missing")
            elif len(one.units) > 1 and (worst_m := one.difference.rms_m) > self.goal_m:
                out.append(f"{one.platform}: {worst_m:.2f} m; expected at most {self.goal_m} m")
            if any(one.collisions):
                out.append(f"{one.platform}: {max(one.collisions)} collisions; expected none")
        return out


class _Run(msgspec.Struct, frozen=True):
    flown: dict[str, Flown]
    units: dict[str, tuple[str, ...]]
    collisions: dict[str, int]
    failure: str


def main(spec: LabSpec, duration_s: float, out_dir: Path, out: Output, *, strict: bool = False) -> int:
    """Runs `lab run distribution`; returns the exit code.

    Raises: SwarmError when a swarm does not come up, ConfigError without the extra `lab`.
    """
    prerequisites.require_modules("lab run", prerequisites.REPORT)
    from swarmlab.report import difference_plot

    name = spec.name or "distribution"
    lumped = msgspec.structs.replace(spec, experiment=MISSION, name=name)
    distributed = msgspec.structs.replace(
        lumped, units=DISTRIBUTED, unit_delay_ms=DELAY_MS, name=f"{name}-units"
    )
    runs = [
        _fly(one, duration_s, out_dir / folder, out)
        for folder, one in (("lumped", lumped), ("distributed", distributed))
    ]
    found: list[VehicleDifference] = []
    paths: dict[str, tuple[VehicleTrack, VehicleTrack]] = {}
    distances: dict[str, tuple[Floats, Floats]] = {}
    first, second = runs
    for platform in sorted(first.flown):
        both = first.flown[platform], second.flown[platform]
        compared = difference(*both)
        if compared is not None:
            paths[platform] = both[0].track, both[1].track
            distances[platform] = compared[1], compared[2]
        hits = first.collisions[platform], second.collisions[platform]
        found.append(
            VehicleDifference(platform, second.units[platform], compared[0] if compared else None, hits)
        )
    failures = tuple(run.failure for run in runs if run.failure)
    report = DistributionReport(DELAY_MS, GOAL_M, tuple(found), failures)
    (out_dir / REPORT).write_bytes(msgspec.json.format(msgspec.json.encode(report), indent=2) + b"\n")
    (out_dir / PICTURE).write_bytes(difference_plot.draw(paths, distances))
    _show(report, out)
    out.say(f"report: {out_dir / PICTURE}")
    misses = report.misses()
    for miss in misses:
        out.warn(f"missed: {miss}")
    return SwarmError.exit_code if failures or (strict and misses) else 0


def _fly(spec: LabSpec, duration_s: float, out_dir: Path, out: Output) -> _Run:
    experiment.prepare(out_dir)
    running, course = experiment.conduct(spec, duration_s, out_dir, out)
    return _read(running, course, out_dir / experiment.LOGS)


def _read(running: RunningLab, course: MissionRun, logs: Path) -> _Run:
    units: dict[str, tuple[str, ...]] = {}
    clocks: dict[str, ClockTruth] = {}
    for node in running.state.nodes:
        if node.kind == PlatformKind.GCS:
            continue
        address = Address.parse(node.platform)
        units[address.platform] = (*units.get(address.platform, ()), address.unit)
        clocks[node.platform] = ClockTruth(node.offset_s, node.drift_ppm)

    def recording(unit: str, *paths: str) -> Recording:
        """Logs of one computer of each platform: of this one where there are several."""
        names = {name: str(Address(name, unit if len(of) > 1 else MAIN)) for name, of in units.items()}
        return Recording(
            {platform: logs / name for platform, name in names.items()},
            {platform: clocks[name] for platform, name in names.items()},
            course.command_mono_ns,
            paths,
        )

    hardware, mission = recording(HARDWARE, TRUTH, COLLISION), recording(MAIN, STATE)
    flown = {
        platform: Flown(
            _after_command(hardware.track(platform)),
            phases(mission.values(platform, STATE, MissionState)),
        )
        for platform in units
    }
    collisions = {
        platform: sum(t_s >= 0 for t_s, _ in hardware.values(platform, COLLISION, Collision))
        for platform in units
    }
    return _Run(flown, units, collisions, course.failure())


def phases(states: Iterable[tuple[float, MissionState]]) -> dict[str, float]:
    """First instant of each block of a mission that is active alone, after the command."""
    begins: dict[str, float] = {}
    for t_s, state in states:
        if t_s >= 0 and len(state.active) == 1:
            begins.setdefault(state.active[0], t_s)
    return begins


def _after_command(track: VehicleTrack) -> VehicleTrack:
    keep = track.t_s >= 0
    return VehicleTrack(track.platform, track.t_s[keep], track.xyz_m[keep], track.yaw_rad[keep])


def _show(report: DistributionReport, out: Output) -> None:
    if out.settings.structured:
        out.exact(report)
        return
    rows = [
        (
            one.platform,
            " ".join(one.units),
            f"{one.difference.rms_m:.3f}" if one.difference else None,
            f"{one.difference.max_m:.3f}" if one.difference else None,
            f"{one.difference.same_time_rms_m:.3f}" if one.difference else None,
            sum(one.collisions),
        )
        for one in report.vehicles
    ]
    columns = [
        Column("VEHICLE"),
        Column("UNITS"),
        Column("RMS m", right=True),
        Column("MAX m", right=True),
        Column("SAME TIME RMS m", right=True),
        Column("COLLISIONS", right=True),
    ]
    out.table(columns, rows)
