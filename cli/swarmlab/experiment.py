"""One experiment: starts a swarm, starts a mission, follows it, stops the swarm, computes the report."""

import shlex
import shutil
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from swarmctl.session.labs import LabNode, LabState
from swarmctl.session.session import Session, connect
from swarmctl.terminal.output import Output
from swarmctl.terminal.progress import Progress
from swarmlab.measure import host, software
from swarmlab.measure.clocks import ClockTruth
from swarmlab.measure.host import HostInfo
from swarmlab.provision import prerequisites, provisioning
from swarmlab.provision.node_files import RADIUS_M
from swarmlab.provision.provisioning import LabSpec
from swarmlab.report.run_metadata import NodeMetadata, RunMetadata, failure
from swarmlab.run import lifecycle
from swarmlab.run.child import exit_description
from swarmlab.run.mission_run import MissionRun
from swarmlab.run.notify import Restarts
from swarmlab.run.running import RunningLab
from swarmlab.run.watch import ENDED, SwarmWatch
from swarmware import __version__
from swarmware.errors import ConfigError, NotFound, SwarmError
from swarmware.mission.manifest import MANIFEST
from swarmware.model import document, paths
from swarmware.model.config import load, share_dir
from swarmware.recorder.address import without_password
from swarmware.types.mission import MissionFile, MissionPlan, MissionState, MissionTask, TaskAnswer

PLAN: Final = "sys/mission/plan"
TASK: Final = "sys/mission/task"
TASK_S: Final = 30.0
"""Maximum wait until all platforms have answered their orders."""
QUIET_S: Final = 15.0
"""Maximum wait until trees and subscriptions are exchanged, so that they do not delay the command."""
RUN_FILE: Final = "run.json"
REPORT: Final = "report.json"
PAGE: Final = "report.html"
LOGS: Final = "logs"
PICTURE: Final = "paths.png"
"""The paths as a picture, for documents."""
MERGED: Final = "run.mcap"
"""The logs of all nodes in one file, for viewers."""
DATA_LOST: Final = 3
"""Exit code of a successful experiment with missing log entries."""


S = TypeVar("S", bound=msgspec.Struct)


def main(spec: LabSpec, duration_s: float, out_dir: Path, out: Output, *, strict: bool = False) -> int:
    """Runs `lab run`; returns the exit code.

    After the command a report is written in any case.
    Raises: SwarmError when the swarm does not come up, ConfigError without the extra `lab`.
    """
    prerequisites.require_modules("lab run", prerequisites.REPORT)
    prerequisites.check_database(spec.mongodb_uri, out)
    prepare(out_dir)
    here = host.describe()
    started_utc_ns = time.time_ns()
    running, course = conduct(spec, duration_s, out_dir, out)
    command = run_command(spec, duration_s, out_dir)
    metadata = _metadata(running, spec, course, started_utc_ns, here, command)
    (out_dir / RUN_FILE).write_bytes(msgspec.json.format(msgspec.json.encode(metadata), indent=1))
    _merge_logs(out_dir, spec.experiment, out)
    return report(out_dir, out, strict=strict)


def run_command(spec: LabSpec, duration_s: float, out_dir: Path) -> str:
    """The command of a run with all options that determine it; a password is masked."""
    words = ["swarmctl", "lab", "run", spec.experiment, "--nodes", str(spec.nodes)]
    if spec.usv:
        words += ["--usv", str(spec.usv)]
    words += ["--net", spec.net, "--seed", str(spec.seed)]
    if spec.radio:
        words += ["--radio", spec.radio]
    if spec.name:
        words += ["--name", spec.name]
    if spec.per_daemon is not None:
        words += ["--per-daemon", spec.per_daemon]
    if spec.units is not None:
        words += ["--units", spec.units]
    for airframe in spec.airframe:
        words += ["--airframe", airframe]
    for service in spec.services:
        words += ["--service", service]
    if spec.mongodb_uri:
        # the line is written to run.json and to the page
        words += ["--mongodb", without_password(spec.mongodb_uri)]
    return shlex.join([*words, "--duration", f"{duration_s:g}", "--out", str(out_dir)])


def conduct(spec: LabSpec, duration_s: float, out_dir: Path, out: Output) -> tuple[RunningLab, MissionRun]:
    """Starts a lab, conducts its mission, ends it, and keeps its logs in the folder.

    Raises: SwarmError when the swarm does not come up.
    """
    running = RunningLab(provisioning.make(spec))
    running.log_of = lambda node: out_dir / _log_of(node)
    try:
        course = lifecycle.run_interruptible(_conduct(running, duration_s, out))
    finally:
        lab = running.state
        with lifecycle.teardown(lab, out):
            # the logs are copied after the end of all processes, when they are complete
            forced = provisioning.down(lab, keep=True)
            running.wait_children()
            _keep_logs(lab, out_dir)
            provisioning.remove(lab)
    if forced:
        out.warn(f"{forced} processes did not end in time and were killed; their logs may lack the end")
    return running, course


def report(out_dir: Path, out: Output, *, strict: bool = False) -> int:
    """Computes, writes and prints the report of a folder with metadata and logs; the exit code.

    With `strict` a missed goal is a failure.
    Raises: NotFound when the folder has no run.json, ConfigError when it is of another version or
        the extra `lab` is not installed.
    """
    prerequisites.require_modules("lab report", prerequisites.REPORT)
    from swarmlab.report import analysis, page, plots
    from swarmlab.report import report as figures

    out.say("computing the report")
    metadata = _read(out_dir / RUN_FILE, RunMetadata)
    found, data = analysis.analyse(metadata, out_dir / LOGS)
    figures_json = msgspec.json.format(msgspec.json.encode(figures.rounded(found)), indent=2)
    (out_dir / REPORT).write_bytes(figures_json + b"\n")
    (out_dir / PICTURE).write_bytes(plots.paths(data))
    shortfalls, misses = figures.shortfalls(found), figures.misses(found)
    remarks = [*metadata.remarks(), *shortfalls]
    remarks += [f"missed: {miss} ({found.host.summary()})" for miss in misses]
    text = page.page(data, found, metadata, remarks, lambda name: (out_dir / name).exists())
    (out_dir / PAGE).write_text(text, "utf-8")
    if out.settings.structured:
        out.exact(figures.rounded(found))
    else:
        out.table(figures.columns(found), figures.cells(found))
        if note := figures.comparison_note(found):
            out.say(note)
    for remark in remarks:
        out.warn(remark)
    out.say(f"report: {out_dir / PAGE}")
    if shortfalls or (strict and misses):
        return SwarmError.exit_code
    # last: a failed mission matters more than gaps in its logs
    return DATA_LOST if found.log_gaps else 0


def page_table(out_dir: Path, out: Output) -> None:
    """Prints the table of an existing report in Markdown.

    Raises: NotFound without a report; ConfigError when it is of another version.
    """
    from swarmlab.report import report as figures

    out.verbatim(figures.markdown(_read(out_dir / REPORT, figures.ExperimentReport)).rstrip())


def _read(path: Path, cls: type[S]) -> S:
    try:
        return document.json(document.read(path), cls, str(path))
    except FileNotFoundError:
        raise NotFound(f"{path}: no such file; expected the folder of a report") from None
    except ConfigError as error:
        raise ConfigError(f"{error}; expected a report of this version") from error


def prepare(out_dir: Path) -> None:
    """Removes an earlier report from the folder; other files are not changed."""
    shutil.rmtree(out_dir / LOGS, ignore_errors=True)
    (out_dir / LOGS).mkdir(parents=True, exist_ok=True)
    for name in (RUN_FILE, REPORT, PAGE, PICTURE, MERGED):
        # a file of the former run would look like a result of this one if the run fails
        (out_dir / name).unlink(missing_ok=True)


async def _conduct(running: RunningLab, duration_s: float, out: Output) -> MissionRun:
    """Conducts the mission. Raises: SwarmError before the command; later errors are recorded in the run."""
    course = MissionRun()
    try:
        await lifecycle.bring_up(running, out)
        try:
            async with connect(lifecycle.station_settings(running.state)) as session:
                await running.attended(_mission(session, running.state, course, duration_s, out))
        except SwarmError as error:
            # before the command there is nothing to report, after it the figures show how far the run came
            if not course.command_mono_ns:
                raise
            course.error = str(error)
        course.close(running.state)
    finally:
        running.stop_watching()
    out.say(f"mission {'completed' if not course.failure() else 'failed: ' + course.failure()}")
    return course


async def _mission(
    session: Session, lab: LabState, course: MissionRun, duration_s: float, out: Output
) -> None:
    watch = SwarmWatch.open(session)
    task = mission_task(lab.experiment)
    # the exchange at the start would count as traffic and delay of the mission
    if not await watch.until_quiet(QUIET_S):
        out.say("the links are still busy; continuing")
    # as `mission start`: the assignment is requested before the instruction
    plan = await session.ask(PLAN, task, MissionPlan, timeout_s=TASK_S)
    for left in plan.left_out:
        out.warn(f"{left.platform}: takes no part: {left.why}")
    course.command()
    try:
        course.answer = answer = await session.ask(TASK, task, TaskAnswer, timeout_s=TASK_S)
    finally:
        # also after an error, as the report needs the processor time from here on
        course.commanded(lab)
    if not answer.accepted:
        reasons = [
            f"{o.platform}: {'; '.join(o.reasons) or 'silent'}" for o in answer.orders if not o.accepted
        ]
        raise SwarmError(f"mission {lab.experiment}: not accepted ({', '.join(reasons)}); expected by all")
    course.accepted(answer)
    out.say(f"mission {answer.mission} accepted by {len(answer.orders)} platforms")
    with Progress(out, "mission", len(answer.orders)) as bar:
        notes: list[str] = []

        def show(states: Mapping[str, MissionState]) -> None:
            note = phase(states)
            done = sum(state.progress_ratio if state.state not in ENDED else 1.0 for state in states.values())
            # without a terminal each change of the note is a line, and each progress would be one
            if not notes or notes[-1] != note or out.lively:
                bar.at(done, note)
                notes.append(note)

        course.in_time = await watch.until_ended(course.members, duration_s, show)


def phase(states: Mapping[str, MissionState]) -> str:
    """Short description of the most frequent states."""
    ended = [state.state for state in states.values() if state.state in ENDED]
    doing = Counter(block for state in states.values() if state.state not in ENDED for block in state.active)
    if not doing:
        return f"{len(ended)} of {len(states)} ended" if ended else ""
    return ", ".join(f"{block} {count}" for block, count in doing.most_common(3))


def mission_task(name: str) -> MissionTask:
    """The mission of this installation, with its files: the ground station needs no copy of it.

    Raises: ConfigError when the installation has none of that name.
    """
    folder = share_dir() / "missions" / name
    files = sorted(path for path in folder.glob("*") if path.name == MANIFEST or path.suffix == ".json")
    return MissionTask(name=name, files=tuple(MissionFile(path.name, document.read(path)) for path in files))


def _log_of(node: LabNode) -> Path:
    """File with the output of a node in the report folder."""
    return Path(LOGS) / node.platform / node.log_file.name


def _keep_logs(lab: LabState, out_dir: Path) -> None:
    for node in lab.nodes:
        target = out_dir / LOGS / node.platform
        target.mkdir(parents=True, exist_ok=True)
        for path in [node.log_file, *paths.log(node.data_dir).glob("*.mcap")]:
            if path.exists():
                shutil.copy2(path, target / path.name)


def _merge_logs(out_dir: Path, world: str, out: Output) -> None:
    from swarmctl.viewers.mcap_export import write_mcap
    from swarmware.geometry.world import World
    from swarmware.recorder.query import FolderSource, Query

    out.say(f"writing {MERGED}")
    folders = sorted((out_dir / LOGS).iterdir())
    origin = load(paths.world(share_dir(), world), World).origin
    entries = FolderSource(folders).entries(Query())
    with (out_dir / MERGED).open("wb") as file:
        write_mcap(entries, file, {folder.name: origin for folder in folders})


def _metadata(
    running: RunningLab,
    spec: LabSpec,
    course: MissionRun,
    started_utc_ns: int,
    here: HostInfo,
    command: str,
) -> RunMetadata:
    lab, answer = running.state, course.answer
    nodes = tuple(_node_metadata(running, course, node) for node in lab.nodes)
    why = failure(nodes, course.failure())
    return RunMetadata(
        experiment=spec.experiment,
        world=spec.experiment,
        seed=lab.seed,
        net=lab.net,
        version=__version__,
        commit=software.commit(),
        versions=software.versions(),
        command=command,
        host=host.shares(here, *course.busy, [node.cpu_percent for node in nodes]),
        started_utc_ns=started_utc_ns,
        ready_s=lab.ready_s,
        command_mono_ns=course.command_mono_ns,
        instructed_ns=answer.instructed_ns if answer else 0,
        end_mono_ns=course.end_mono_ns,
        completed=not why,
        failure=why,
        orders=answer.orders if answer else (),
        nodes=nodes,
    )


def _node_metadata(running: RunningLab, course: MissionRun, node: LabNode) -> NodeMetadata:
    code = running.fallen.get(node.platform)
    restarts = running.restarts.get(node.platform, Restarts())
    whole = code is None and not restarts.count  # the processor time of a process goes with it
    return NodeMetadata(
        platform=node.platform,
        kind=node.kind,
        radius_m=RADIUS_M.get(node.kind, 0.0),
        clock=ClockTruth(node.offset_s, node.drift_ppm),
        processes=node.processes,
        outcome=course.outcome.states.get(node.platform, ""),
        restarts=restarts,
        ended="" if code is None else exit_description(code),
        log=str(_log_of(node)),
        cpu_percent=course.percent(node.platform) if whole else None,
        rss_mb=course.after[node.platform].rss_mb if code is None else None,
        pss_mb=course.after[node.platform].pss_mb if code is None else None,
    )
