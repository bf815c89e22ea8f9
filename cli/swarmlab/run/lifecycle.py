"""Start, operation and end of a lab, including its interruption by Ctrl-C."""

import asyncio
import signal
import time
from collections.abc import Coroutine, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final, TypeVar

import msgspec

from swarmctl.commandline.settings import CliSettings
from swarmctl.session import labs, processes
from swarmctl.session.labs import LabState
from swarmctl.session.session import connect
from swarmctl.terminal.output import Output
from swarmctl.terminal.progress import Progress
from swarmlab.provision import plan, prerequisites, provisioning
from swarmlab.provision.provisioning import LabSpec
from swarmlab.run import listing
from swarmlab.run.capacity import Capacity
from swarmlab.run.running import RunningLab
from swarmlab.run.watch import SwarmWatch
from swarmware.errors import NoAnswer
from swarmware.model.names import platform_of
from swarmware.model.platform_kind import PlatformKind
from swarmware.transport.appfile import table

T = TypeVar("T")

UP_S: Final = 120.0
"""Maximum wait for a swarm to start; two cores start sixteen nodes in a tenth of it."""


class EndedLab(msgspec.Struct, frozen=True):
    """A lab that was ended."""

    name: str
    nodes: int
    forced: int
    """Processes that did not end in time and were killed."""
    left: list[str] = []
    """Modules of other processes that had joined a node, as `PLATFORM: NAME#1 (process 123)`."""


class EndedLabs(msgspec.Struct, frozen=True):
    """Labs that were ended."""

    ended: list[EndedLab]


def run_interruptible(main: Coroutine[Any, Any, T]) -> T:
    """Runs a coroutine; SIGTERM and a closed terminal interrupt it like Ctrl-C, so that the lab is ended.

    Raises: KeyboardInterrupt when it was interrupted.
    """

    async def interruptible() -> T:
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        assert task is not None
        for number in (signal.SIGTERM, signal.SIGHUP):
            # without a handler these signals end the process at once, and the nodes stay behind
            loop.add_signal_handler(number, task.cancel)
        return await main

    try:
        return asyncio.run(interruptible())
    except asyncio.CancelledError:
        raise KeyboardInterrupt from None


@contextmanager
def teardown(lab: LabState, out: Output) -> Iterator[None]:
    """Blocks signals while a lab ends: a second Ctrl-C does not interrupt it."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, signal.SIG_IGN) for number in numbers}
    try:
        with suppress(OSError):  # the terminal may be closed, which may be the reason of the end
            out.say(f"ending lab {lab.name}")
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def station_settings(lab: LabState) -> CliSettings:
    """Settings that join the lab's ground station."""
    return CliSettings(config=str(lab.station.config_dir))


async def bring_up(running: RunningLab, out: Output) -> float:
    """Starts all nodes and waits until the ground station has all trees; returns the seconds that it took.

    Raises: SwarmError when a node ends or the processor is too slow, NoAnswer at the time-out.
    """
    lab = running.state
    prerequisites.check_shared_memory(provisioning.SHM, len(lab.nodes))
    running.on_restart = lambda platform, what: out.warn(f"node {platform}: {what}")
    await running.start_shared(UP_S)
    order = plan.start_order([node.platform for node in lab.nodes], lab.seed)
    with Progress(out, f"starting {len(lab.nodes)} nodes of lab {lab.name}", 2 * len(lab.nodes)) as bar:
        running.watcher = lambda platform, what: bar.advance(f"{platform} {what}")
        # made before the first start, because it samples the load of the computer without the lab
        capacity = Capacity(len(order))
        await running.start(order[: capacity.first], UP_S)
        if rest := order[capacity.first :]:
            await capacity.check_first(running.state)
            await running.start(rest, UP_S)
    names = (node.platform for node in lab.nodes if node.kind != PlatformKind.GCS)
    vehicles = list(dict.fromkeys(map(platform_of, names)))
    with Progress(out, "waiting until the ground station knows every tree", len(vehicles)) as bar:
        # the ground station's view counts, as it is the node that commands join
        async with connect(station_settings(lab)) as session:
            watch = SwarmWatch.open(session)
            try:
                await running.attended(watch.until_known(vehicles, UP_S, bar.at))
            except NoAnswer as error:
                raise NoAnswer(f"{error}; {capacity.describe()}") from error
    if short := await capacity.check_all(running.state):
        out.warn(short)
    ready_s = running.save_ready()
    out.say(f"{len(lab.nodes)} nodes ready after {ready_s:.1f} s")
    return ready_s


def main(spec: LabSpec, out: Output, *, detach: bool) -> None:
    """Runs `lab up`.

    Raises: SwarmError when the swarm does not come up.
    """
    prerequisites.check_database(spec.mongodb_uri, out)
    running = RunningLab(provisioning.make(spec))
    left_running = False
    try:
        left_running = run_interruptible(_up(running, out, detach=detach))
    finally:
        if left_running:
            running.detach()
        else:
            with teardown(running.state, out):
                provisioning.down(running.state)
                running.wait_children()


async def _up(running: RunningLab, out: Output, *, detach: bool) -> bool:
    name = running.state.name
    try:
        await bring_up(running, out)
        if out.settings.structured:
            out.document(listing.describe(running.state, time.time_ns()))
        if detach:
            out.say(f"lab {name} is up; `swarmctl lab down {name}` ends it")
            return True
        out.say("Ctrl-C ends it")
        await _stay(running, out)
        return False
    finally:
        # before the event loop ends: the watchers are registered in it
        running.stop_watching()


async def _stay(running: RunningLab, out: Output) -> None:
    """Waits until an interruption or the end of all nodes."""
    reported: set[str] = set()
    while len(reported) < len(running.state.nodes):
        await running.until_fallen(reported)
        for platform in sorted(running.fallen.keys() - reported):
            out.warn(f"node {platform} ended (code {running.fallen[platform]})")
            reported.add(platform)


def end_labs(name: str, out: Output, *, everything: bool, keep: bool) -> None:
    """Runs `lab down`: ends the named lab, the newest, or with `everything` all of this user.

    `keep`: do not remove configuration and logs.
    Raises: NotFound without such a lab, NoAnswer when a process does not end.
    """
    found = labs.labs() if everything else [labs.find_left(name or out.settings.lab)]
    ended = []
    for lab in found:
        out.say(f"ending lab {lab.name}: {len(lab.nodes)} nodes")
        # before the end, which removes the files that list the modules
        left = _modules_of_others(lab)
        if left:
            out.warn(
                f"lab {lab.name}: modules that the lab has not started have joined it: {'; '.join(left)}."
                " They are not ended; what they write from now on is lost: end and start them again"
            )
        forced = provisioning.down(lab, keep=keep)
        if forced:
            out.warn(f"lab {lab.name}: {forced} processes did not end in time and were killed")
        ended.append(EndedLab(lab.name, len(lab.nodes), forced, left))
    if out.settings.structured:
        out.document(EndedLabs(ended))


def _modules_of_others(lab: LabState) -> list[str]:
    """Modules that have joined a node, of processes that the lab has not started and does not end."""
    # by the mark, which processes of an operator do not have, even if they joined a node
    own = {process.pid for process in processes.marked(lab.mark)}
    return [
        f"{node.platform}: {entry.id} (process {entry.pid})"
        for node in lab.nodes
        for entry in table.scan(node.run_dir)
        if entry.pid not in own
    ]
