"""Brings all hosts to a goal: in parallel, each by its own steps; the failure of one does not stop others."""

import asyncio
from collections.abc import Callable, Sequence
from typing import Final

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.fleet.plan import (
    FleetGoal,
    FleetStep,
    HostState,
    HostStatus,
    HostTarget,
    Step,
    next_step,
)
from swarmctl.commands.fleet.progress import FleetProgress
from swarmctl.commands.fleet.remote import Remote, Wheel
from swarmctl.commands.fleet.synchronisation import Synchronisation, synchronisation
from swarmctl.membership.hosts import FleetHost, digest, files
from swarmctl.terminal.node_output import raise_errors
from swarmctl.terminal.output import Output
from swarmware.errors import Conflict, NoAnswer, SwarmError

PARALLEL: Final = 16
"""Hosts at the same time: each costs an `ssh` process here."""


class FleetRun:
    """One command at all its hosts."""

    def __init__(
        self,
        goal: FleetGoal,
        out: Output,
        *,
        wheel: Wheel | None = None,
        wait_s: float = 60.0,
        force: bool = False,
        sync: Synchronisation | None = None,
    ) -> None:
        self._goal = goal
        self._out = out
        self._wheel = wheel
        self._wait_s = wait_s
        self._force = force
        self._sync = sync
        self.outcomes: dict[str, FleetStep] = {}
        self.errors: dict[str, SwarmError] = {}

    async def at_all(self, hosts: Sequence[FleetHost], parallel: int, *, stops: bool) -> None:
        """Brings each host to the goal; `stops`: after a failure no further host is begun."""
        slots = asyncio.Semaphore(parallel)
        with FleetProgress(self._out, [host.name for host in hosts]) as progress:

            async def one(host: FleetHost) -> None:
                async with slots:
                    if stops and self.errors:  # a wheel that breaks one host would break the next
                        outcome = FleetStep(host.name, HostState.NOT_BEGUN, done=True)
                    else:
                        outcome = await self._outcome(host, progress.show)
                self.outcomes[host.name] = outcome
                progress.show(outcome)

            async with asyncio.TaskGroup() as group:
                for host in hosts:
                    group.create_task(one(host), name=host.name)

    def check(self, asked: int) -> None:
        """Check that all hosts reached the goal.

        Raises: as `raise_errors`.
        """
        errors = dict(self.errors)
        for name, outcome in self.outcomes.items():
            if outcome.state == HostState.NOT_BEGUN:
                errors[name] = Conflict("not begun, because another host failed")
        raise_errors(asked, errors)

    async def _outcome(self, host: FleetHost, show: Callable[[FleetStep], None]) -> FleetStep:
        done: list[Step] = []
        try:
            await self._steps(host, done, show)
        except (SwarmError, OSError) as error:
            failure = error if isinstance(error, SwarmError) else SwarmError(str(error))
            self.errors[host.name] = failure
            synchronised = False if Step.SYNCHRONISE in done else None
            return FleetStep(
                host.name, HostState.FAILED, True, tuple(done), synchronised, str(failure), failure.exit_code
            )
        return FleetStep(host.name, HostState.DONE, True, tuple(done), Step.SYNCHRONISE in done or None)

    async def _steps(self, host: FleetHost, done: list[Step], show: Callable[[FleetStep], None]) -> None:
        """Raises: SwarmError and OSError of the step that failed."""
        remote = Remote(host, self._out.settings.timeout_s, self._wait_s, force=self._force)
        wanted = HostTarget(
            self._goal,
            self._wheel.sum if self._wheel is not None else "",
            digest(files(host)) if self._goal is FleetGoal.PUSH else "",
            self._sync is not None,
        )
        show(FleetStep(host.name, HostState.CONNECT))
        seen = await remote.status()
        while (step := next_step(wanted, seen, done)) is not None:
            show(FleetStep(host.name, HostState(step), steps=tuple(done)))
            done.append(step)
            seen = await self._carry_out(step, remote, seen)

    async def _carry_out(self, step: Step, remote: Remote, seen: HostStatus) -> HostStatus:
        match step:
            case Step.PUSH:
                return await remote.push()
            case Step.START:
                return await remote.start()
            case Step.STOP:
                return await remote.stop(resume=self._goal is FleetGoal.UPGRADE)
            case Step.SYNCHRONISE:
                if self._sync is not None:
                    await self._sync.until(remote.host.name, self._wait_s)
                return seen
            case Step.UPLOAD | Step.INSTALL:
                assert self._wheel is not None, "planned with a wheel only"
                if step is Step.UPLOAD:
                    await remote.upload(self._wheel)
                    return seen
                return await self._install(self._wheel, remote, seen)

    async def _install(self, wheel: Wheel, remote: Remote, seen: HostStatus) -> HostStatus:
        """Raises: SwarmError; the node that was stopped for it runs with the former software again."""
        try:
            await remote.install(wheel)
        except NoAnswer:
            raise  # nothing can be started there now; a repeated call continues from here
        except SwarmError as error:
            # only a node that this command stopped is started again
            if not seen.resume:
                raise
            await remote.start()
            raise SwarmError(f"{error}; the node runs again with {seen.version}") from error
        return await remote.status()


async def bring(  # noqa: PLR0913 - an argument for each option
    settings: CliSettings,
    hosts: Sequence[FleetHost],
    goal: FleetGoal,
    *,
    wheel: Wheel | None = None,
    parallel: int = PARALLEL,
    wait_s: float = 60.0,
    force: bool = False,
    sync: bool = False,
    stops: bool = False,
) -> None:
    """Brings hosts to a goal and shows the progress of each.

    Raises: as `raise_errors`; as `synchronisation`.
    """
    out = Output(settings)
    if not sync:
        run = FleetRun(goal, out, wheel=wheel, wait_s=wait_s, force=force)
        await run.at_all(hosts, parallel, stops=stops)
    else:
        async with synchronisation(settings) as found:
            if found is None:
                out.say("no node runs on this machine: whether data are synchronised is not examined")
            run = FleetRun(goal, out, wheel=wheel, wait_s=wait_s, force=force, sync=found)
            await run.at_all(hosts, parallel, stops=stops)
    run.check(len(hosts))
