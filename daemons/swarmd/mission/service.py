"""The mission daemon's shell: receives orders and states, runs blocks, publishes the state."""

import asyncio
import logging
import random
from collections.abc import Awaitable, Iterable
from typing import ClassVar, Final

import msgspec

from swarmd.mission.acceptance import OrderAcceptance
from swarmd.mission.blocks.plugins import installed
from swarmd.mission.builtin import built_in, manoeuvre
from swarmd.mission.checking import Checker
from swarmd.mission.config import Config as Settings
from swarmd.mission.core.admission import drained_text
from swarmd.mission.core.announcement import HEARTBEAT_NS, INTERVAL_NS
from swarmd.mission.core.barrier import lead_to_ns
from swarmd.mission.core.census import Census
from swarmd.mission.core.run import Action, Announce, CancelBlock, ProgressStep, Run, StartBlock, TakeVehicle
from swarmd.mission.core.scheduler import MissionScheduler
from swarmd.mission.dispatcher import ORDER_PATH, Dispatcher
from swarmd.mission.drain import Drain
from swarmd.mission.fence_watch import FenceWatch
from swarmd.mission.first_states import FirstStates
from swarmd.mission.member_states import MemberStates
from swarmd.mission.progress_record import ProgressRecord
from swarmd.mission.reaction_watch import ReactionWatch
from swarmd.mission.rehearsal import SETTLED_S, Rehearsal
from swarmd.mission.run_control import RunControl
from swarmd.mission.run_folder import RunDisk, RunFolders
from swarmd.mission.runner import BlockRunner
from swarmd.mission.store import MissionStore
from swarmd.mission.values import Values
from swarmd.mission.vehicle import VehicleClient
from swarmware.errors import Conflict, InvalidInput, MissionError, SwarmError
from swarmware.mission.assignment import Platform
from swarmware.mission.finding import Finding
from swarmware.mission.model import MissionDefinition
from swarmware.mission.outcome import BlockOutcome
from swarmware.model import paths
from swarmware.model.clock import utc_ns
from swarmware.model.platform_kind import VEHICLES
from swarmware.model.resource import Resource
from swarmware.module.board import BoardReader
from swarmware.module.boardset import BoardSet
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.service.live_config import LiveConfig
from swarmware.service.service import Service
from swarmware.types.mission import (
    INACTIVE,
    BarrierResult,
    DrainOrder,
    LeftOut,
    ManoeuvreRequest,
    MissionList,
    MissionOrder,
    MissionPlan,
    MissionProgress,
    MissionReceipt,
    MissionState,
    MissionStatus,
    MissionTask,
    OrderReceipt,
    TaskAnswer,
)
from swarmware.types.net import Neighbours, RosterState, Routes
from swarmware.types.rpc import Empty
from swarmware.types.traffic import Traffic

log = logging.getLogger("swarm.mission")


STATE: Final = Resource(
    path="mission/state",
    type="MissionState",
    rate_hz=1e9 / INTERVAL_NS,  # rate of changes; a lower one would delay barriers
    max_age_s=3.5 * HEARTBEAT_NS / 1e9,
    log="all",
    link="tick",
    description="State of the platform's mission, also used by barriers",
)


class Mission(Service):
    """Accepts orders and plays them with the ensemble; at the ground station also sends them."""

    name: ClassVar[str] = "mission"
    Config: ClassVar[type[msgspec.Struct]] = Settings
    live_settings: ClassVar = {"link_loss": "mission/link_loss", "link_loss_s": "mission/link_loss_s"}

    module: Module
    config: Settings

    def __init__(self, module: Module, config: Settings) -> None:
        super().__init__(module, config)
        node = module.node.config
        self._kind = node.kind
        self._plugins = installed()
        self._checker = Checker(self._plugins.catalogue)
        self._drain = Drain(paths.drain_record(node.data_path))
        self._values = Values(module)
        self._core = self._new_core()
        self._driver = self.drive(self._core, self._perform)
        vehicle = VehicleClient.open(module, self.config) if self._kind in VEHICLES else None
        self._vehicle = vehicle
        self._runner = BlockRunner(module, vehicle, self._plugins, self._ended, self._core.report)
        self._store = MissionStore(
            (paths.missions(node.data_path), node.share_path / "missions"), self._checker
        )
        self._rehearsal = Rehearsal(module.platform, self._store, self._checker, self._values, self._rehearse)
        self._state: BoardWriter[MissionState] = module.writer(STATE, MissionState)
        progress: BoardWriter[MissionProgress] = module.stream_writer(
            "mission/progress", MissionProgress, kind="event", log="all", description="Steps of the mission"
        )
        self._runs = RunFolders(RunDisk(module.platform, node.data_path, config.kept_runs), module.clock)
        self._record = ProgressRecord(progress, module.clock, self._runs.add)
        receipts: BoardWriter[OrderReceipt] = module.stream_writer(
            "mission/orders",
            OrderReceipt,
            kind="event",
            log="all",
            description="Result of each order to a platform",
        )
        self._acceptance = OrderAcceptance(
            module,
            self._kind,
            self._checker,
            self._values,
            self._drain,
            self._core,
            self._check_order,
            self._take_order,
        )
        self._dispatcher = Dispatcher(
            module, self.config, self._store, self._checker, receipts, self._acceptance.on_order
        )
        self._others: BoardSet[MissionState] = module.readers("/*/mission/state", MissionState)
        self._member_states = MemberStates(
            self._others, module.clock, lambda: self._core.is_idle, self._take_states
        )
        self._census = Census(module.platform, round(self.config.lost_after_s * 1e9))
        self._first_states = FirstStates(
            self._census, module.clock, self._take_routes, is_station=self._kind not in VEHICLES
        )
        self._roster: BoardReader[RosterState] = module.reader("net/roster", RosterState)
        self._routes: BoardReader[Routes] = module.reader("net/routes", Routes)
        self._traffic: BoardReader[Traffic] = module.reader("net/traffic", Traffic)
        self._neighbours: BoardReader[Neighbours] = module.reader("net/neighbours", Neighbours)
        self._fence = FenceWatch(module, config.fence) if vehicle is not None else None
        self._reactions: ReactionWatch | None = None
        if vehicle is not None:
            live = LiveConfig(module, config, self.live_settings)
            self._reactions = ReactionWatch(
                module, live, config, self._values, vehicle, self._core, self._driver.feed, self._order_stored
            )
        self._run_control = RunControl(
            module,
            self._core,
            self._dispatcher,
            lambda: {module.platform: self._now_state(), **self._present()},
            self._driver.feed,
            self._check_reactions,
        )
        self._serve()

    async def run(self) -> None:
        """Run the daemon until cancelled."""
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._driver.run(), name="mission:driver")
                group.create_task(self._member_states.run(), name="mission:others")
                group.create_task(self._run_control.run(), name="mission:runs")
                group.create_task(self._watch_links(), name="mission:links")
                group.create_task(self._prepare(), name="mission:store")
                if self._vehicle is not None:
                    group.create_task(self._watch_control(self._vehicle), name="mission:control")
                if self._fence is not None and (limits := self.config.fence) is not None:
                    group.create_task(self._fence.run(limits), name="mission:fence")
                if self._reactions is not None:
                    group.create_task(self._reactions.run(), name="mission:reactions")
        finally:
            await self._runner.close()
            self._record.close()
            self._runs.close()

    def _serve(self) -> None:
        module = self.module
        module.serve(
            ORDER_PATH, MissionOrder, self._on_order, reply=MissionReceipt, description="Order of a mission"
        )
        module.serve(
            "sys/mission/task",
            MissionTask,
            self._on_task,
            reply=TaskAnswer,
            description="One instruction to the swarm: a mission, by name or by content",
        )
        module.serve(
            "sys/mission/plan",
            MissionTask,
            self._on_plan,
            reply=MissionPlan,
            description="Assignment of roles without an order, and platforms without a role",
        )
        module.serve(
            "sys/mission/manoeuvre",
            ManoeuvreRequest,
            self._on_manoeuvre,
            reply=MissionStatus,
            description="A manoeuvre of this vehicle: takeoff, goto",
        )
        self._runs.serve(module)
        module.serve(
            "sys/mission/status",
            Empty,
            self._on_status,
            reply=MissionStatus,
            description="State of the mission",
        )
        module.serve(
            "sys/mission/ls", Empty, self._on_list, reply=MissionList, description="Missions of the store"
        )
        module.serve(
            "sys/mission/drain",
            DrainOrder,
            self._on_drain,
            reply=MissionStatus,
            description="Take no role in a new mission, until this is ended",
        )

    # -- input

    def _on_order(self, order: MissionOrder, meta: Meta) -> MissionReceipt | Awaitable[MissionReceipt]:
        received_ns = meta.arrived_ns or self.module.now_ns()
        by = self.module.requester(meta)
        return self._acceptance.on_order(order, received_ns, self.module.requesting_platform(meta), by)

    def _check_order(self, order: MissionOrder, mission: MissionDefinition) -> None:
        self._check_reactions(order.mission)
        self._check_fence(order.file, mission)

    def _new_core(self) -> MissionScheduler:
        missions = built_in(self.module.platform, self._kind, self.config.emergency_descent_m_s)
        return MissionScheduler(
            self.module.platform, missions, self._values, random.random, self.config, self._lead_ns
        )

    def _rehearse(self, order: MissionOrder, mission: MissionDefinition) -> None:
        self._acceptance.rehearse(order, mission, self._new_core())

    def _order_stored(self, name: str, priority: int, reason: str) -> None:
        """A reaction starts a stored mission of this platform alone, without the network."""
        self.module.start(self._play_stored(name, priority, reason), "mission of a reaction")

    async def _play_stored(self, name: str, priority: int, reason: str) -> None:
        me = self.module.platform
        task = MissionTask(name, members=(me,), priority=priority)
        try:
            now_ns = self.module.now_ns()
            answer = await self._dispatcher.task(task, [Platform(me, self._kind)], [], now_ns)
        except SwarmError as error:
            log.error("reaction (%s): mission %s was not started: %s", reason, name, error)
            return
        if not answer.accepted:
            log.error("reaction (%s): mission %s was refused: %s", reason, name, answer.orders[0].reasons)

    def _take_order(self, run: Run, order: MissionOrder, findings: tuple[Finding, ...]) -> None:
        actions = self._core.on_order(run, self.module.now_ns())
        self._runs.begin(order, run.by, findings)
        # the reply is sent first: the ground station waits for it, others get the state with the next beacon
        self._driver.defer(actions)
        asyncio.get_running_loop().call_soon(self._taken, run.epoch)

    def _taken(self, epoch: int) -> None:
        """Evaluates states of this run that members published before this platform accepted the order."""
        self._member_states.take_news()
        if platforms := self._census.in_run(epoch):
            self._take_states(platforms)

    async def _on_task(self, task: MissionTask, meta: Meta) -> TaskAnswer:
        instructed_ns = self._instructed_ns(meta)
        await self._first_states.wait()
        return await self._dispatcher.task(
            task, self._platforms(), self._absent(), instructed_ns, meta.sender
        )

    async def _on_plan(self, task: MissionTask, meta: Meta) -> MissionPlan:
        await self._first_states.wait()
        return await self._dispatcher.plan(task, self._platforms(), self._absent())

    def _platforms(self) -> list[Platform]:
        """This platform and all others that are present, without those that are drained."""
        states = {self.module.platform: self._now_state(), **self._present()}
        return [Platform(name, state.kind) for name, state in states.items() if not state.drained_by]

    def _instructed_ns(self, meta: Meta) -> int:
        """Instant at which the instruction was given at this platform, or arrived from another one."""
        now_ns = self.module.now_ns()
        # a stamp of another computer is on the clock of that computer
        return min(meta.stamp_ns, now_ns) if meta.sender_hw == self.module.node.hardware else now_ns

    def _on_manoeuvre(self, request: ManoeuvreRequest, meta: Meta) -> MissionStatus:
        vehicle = self._vehicle
        if vehicle is None:
            raise InvalidInput(f"{request.name}: {self.module.platform} is not a vehicle")
        by = self.module.requester(meta)
        reason = f"{request.name} by {by}: {request.reason}"
        force = reason if request.force else ""
        mission = manoeuvre(request.name, request.params, self.module.platform, self._kind, force=force)
        if request.name == "goto" and not vehicle.armed:
            raise Conflict(f"goto: {self.module.platform} is disarmed; arm it, or `takeoff`, first")
        if request.name == "goto" and vehicle.flies and vehicle.landed:
            raise Conflict(f"goto: {self.module.platform} is on the ground; `takeoff` first")
        self._check_reactions(request.name)
        self._check_fence(request.name, mission)
        log.warning("%s%s", reason, " (forced)" if force else "")
        now_ns = self.module.now_ns()
        self._driver.defer(self._core.on_manoeuvre(request.name, mission, reason, now_ns))
        return self._on_status(Empty(), meta)

    def _check_reactions(self, order: str) -> None:
        """Check that no reaction forbids an order. Raises: Conflict."""
        if self._reactions is not None:
            self._reactions.check_order(order)

    def _check_fence(self, what: str, mission: MissionDefinition) -> None:
        """Check that no target of a mission is outside the fence. Raises: MissionError."""
        if self._fence is not None and (reason := self._fence.refusal(mission)):
            raise MissionError(f"{what}: {reason}")

    def _on_status(self, request: Empty, meta: Meta) -> MissionStatus:
        core = self._core
        return MissionStatus(
            self.module.platform,
            self._now_state(),
            core.role,
            core.since_ns,
            core.members,
            self._present(),
            core.unmet,
            core.ordered_by,
            () if self._reactions is None else self._reactions.state.rows,
        )

    def _on_drain(self, order: DrainOrder, meta: Meta) -> MissionStatus:
        by = self.module.requester(meta)
        if order.drained and not self._drain.by:
            self._drain.begin(by, utc_ns())
            log.warning("drained by %s: no role in a new mission", by)
        elif not order.drained and self._drain.by:
            self._drain.end()
            log.warning("drain ended by %s", by)
        self._state.write(self._now_state())
        return self._on_status(Empty(), meta)

    async def _on_list(self, request: Empty, meta: Meta) -> MissionList:
        return MissionList(await self._store.list())

    def _take_states(self, platforms: Iterable[str]) -> None:
        """Passes the newest states of these platforms to the core."""
        states: list[tuple[str, MissionState, tuple[BarrierResult, ...]]] = []
        now_ns = self.module.now_ns()
        for platform in platforms:
            reader = self._others[platform]
            state, meta = reader.value, reader.meta
            if state is not None and meta is not None:
                # the value may be old, of a platform that is lost
                self._census.on_state(platform, state, now_ns - round(max(reader.age_s or 0.0, 0.0) * 1e9))
                meetings = tuple(self._local(meeting, meta, now_ns) for meeting in state.meetings)
                states.append((platform, state, meetings))
        self._driver.feed(self._core.on_states(states, now_ns))
        self._first_states.on_states()

    def _local(self, meeting: BarrierResult, meta: Meta, now_ns: int) -> BarrierResult:
        """The barrier result with its instant on this platform's clock."""
        if meeting.leave_ns is None:
            return meeting
        local_ns = self.module.remote_clocks.to_local(meta.sender_hw, meeting.leave_ns)
        if local_ns is None:
            # no conversion yet: the time that remained when it was written, at most a beacon period ago
            local_ns = now_ns + meeting.leave_ns - meta.stamp_ns
        return msgspec.structs.replace(meeting, leave_ns=local_ns)

    def _lead_ns(self, platforms: frozenset[str]) -> int:
        """Time that a barrier result takes to reach these platforms at the present beacon rates."""
        traffic = self._traffic.value
        return lead_to_ns(
            platforms,
            min_ns=round(self.config.barrier_lead_s * 1e9),
            own_hz=0.0 if traffic is None else traffic.tick_hz,
            routes=self._routes.value,
            neighbours=self._neighbours.value,
        )

    async def _watch_links(self) -> None:
        async for _ in self.module.every(HEARTBEAT_NS / 1e9):
            self._take_routes()

    def _take_routes(self) -> None:
        """Takes the platforms that are in reach now."""
        routes, now_ns, stations = self._routes.value, self.module.now_ns(), 0
        # an old table is of a link daemon that stopped: no platform counts as reached by it
        if routes is not None and (self._routes.age_s or 0.0) < self.config.lost_after_s:
            for route in routes.routes:
                self._core.on_alive(route.platform, now_ns)
                self._census.on_reachable(route.platform, now_ns)
                stations += self._census.is_station(route.platform)
        if self._reactions is not None:
            self._reactions.on_stations(stations > 0)

    async def _watch_control(self, vehicle: VehicleClient) -> None:
        async for control in vehicle.control:
            self._driver.feed(self._core.on_control(control, self.module.now_ns()))

    async def _take_vehicle(self, vehicle: VehicleClient, ordered: bool) -> None:
        try:
            await vehicle.take(ordered=ordered)
        except SwarmError as error:
            log.warning("the mission manager does not drive: %s", error)

    async def _prepare(self) -> None:
        """Checks stored missions and reads their parts before the first instruction, which then needs no
        wait."""
        for mission in await self._store.list():
            if not mission.sound:
                log.warning(
                    "stored mission %s: %d findings; expected a sound one", mission.name, mission.findings
                )
        async for _ in self.module.every(SETTLED_S):
            platforms = frozenset(self._platforms())
            if self._rehearsal.due(platforms):
                await self._rehearsal.play(platforms)

    # -- output

    def _ended(self, token: int, result: BlockOutcome, text: str) -> None:
        self._driver.feed(self._core.on_ended(token, result, text, self.module.now_ns()))

    def _perform(self, action: Action) -> None:
        match action:
            case StartBlock():
                self._runner.start(action)
            case CancelBlock(token):
                self._runner.cancel(token)
            case ProgressStep():
                self._record.add(self._progress(action))
            case TakeVehicle(ordered):
                if self._vehicle is not None:
                    self.module.start(self._take_vehicle(self._vehicle, ordered), "take the vehicle")
            case Announce(state):
                if state.state not in INACTIVE:  # barriers need the states of the others without delay
                    self._member_states.on_mission()
                self._state.write(self._own(state))

    def _progress(self, step: ProgressStep) -> MissionProgress:
        epoch, now_ns = step.epoch or self._core.epoch, self.module.now_ns()
        return MissionProgress(step.mission, epoch, step.block, step.type, step.event, now_ns, step.text)

    def _now_state(self) -> MissionState:
        return self._own(self._core.state())

    def _own(self, state: MissionState) -> MissionState:
        """A state of the core, completed by the kind of this platform and by its drain."""
        return msgspec.structs.replace(state, kind=self._kind, drained_by=self._drain.by)

    def _present(self) -> dict[str, MissionState]:
        self._member_states.take_news()
        return self._census.present(self.module.now_ns())

    def _absent(self) -> list[LeftOut]:
        self._member_states.take_news()
        roster = self._roster.value
        members = () if roster is None else roster.members
        # a revoked member is not missed: its datagrams are no longer accepted
        self._census.roster = frozenset(each.platform for each in members if not each.revoked)
        absent = self._census.absent(self.module.now_ns())
        if self._drain.by:
            absent.append(LeftOut(self.module.platform, drained_text(self._drain.by)))
        return absent
