"""One member of an ensemble: order, common start, play, failure, built-in missions, published state."""

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Final

import msgspec

from swarmd.mission.config import Config
from swarmd.mission.core.barrier import Barriers, BarrierSpec, Passed
from swarmd.mission.core.commons import Commons
from swarmd.mission.core.player import Player
from swarmd.mission.core.requirements import TURNS, RequirementWatch
from swarmd.mission.core.run import (
    MAKING_WAY,
    PLAYING,
    RESUMED,
    STARTED,
    Action,
    CancelBlock,
    EnterBarrier,
    LeaveBarrier,
    PhaseEvent,
    PlayEnded,
    PlayerAction,
    PlayResult,
    PlaySuspended,
    ProgressStep,
    Run,
    StartBlock,
    TakeVehicle,
    follow,
)
from swarmware.errors import Conflict
from swarmware.mission.catalogue import Barrier
from swarmware.mission.condition import Lookup
from swarmware.mission.model import Block, MissionDefinition
from swarmware.mission.outcome import SUCCESS, BlockOutcome
from swarmware.mission.reaction import STRENGTH, ReactionRow
from swarmware.types.control import ControlState, DriveMode
from swarmware.types.mission import HASH_DIGITS, BarrierResult, Member, MissionPhase, MissionState

START: Final = "@start"
"""The barrier before Start: no member begins unless all have accepted the order."""


class MissionExecutor:
    """Decides about this platform's mission; the shell runs blocks, writes boards and receives states.

    Actions of the player and ends of barrier waits are items of one queue, which one loop processes.
    Items that result from an item are processed before those queued earlier.
    """

    def __init__(
        self,
        platform: str,
        built_in: Mapping[str, MissionDefinition],
        lookup: Lookup,
        chance: Callable[[], float],
        config: Config,
        lead: Callable[[frozenset[str]], int],
        commons: Commons,
    ) -> None:
        """`lead`: returns the nanoseconds that the result of a barrier needs to reach these platforms."""
        self._platform = platform
        self._built_in = built_in
        """Built-in missions of this kind of vehicle, such as land and hold; empty at a ground station."""
        self._playable = dict(built_in)
        """Built-in missions, and the newest manoeuvres that an operator ordered, such as goto."""
        self._ordered = False
        """Whether an operator ordered the built-in mission, which then takes the vehicle from its driver."""
        self._lookup = lookup
        self._chance = chance
        self._config = config
        self._commons = commons
        self._delay = commons.delay
        self._lead = lead
        self._phase = MissionPhase.IDLE
        self._since_ns = 0
        self._run: Run | None = None
        self._player: Player | None = None
        self.playing = ""
        """Name of the mission that is played, perhaps a built-in one."""
        self._title = ""
        """Name reported at the end: the mission, or the built-in mission that an operator ordered."""
        self._barriers: Barriers | None = None
        self._blocks: dict[int, Block] = {}
        """Barriers at which the mission waits, by token."""
        self._verdict: PhaseEvent = PhaseEvent.DONE
        self._reason = ""
        self._recovery = ""
        self._recovering = False
        self._discarded = False
        """The mission was ended while another one had the vehicle: no built-in mission follows."""
        self._queue: deque[PlayerAction | Passed] = deque()
        self._actions: list[Action] = []
        """Actions for the shell that result from the current event."""
        self._text = ""
        self._ratios: dict[int, float] = {}
        self._requirements = RequirementWatch((), lookup, self._delay)
        self.makes_way_for = ""
        """Why the mission is suspended, or "" if it is not."""

    @property
    def phase(self) -> MissionPhase:
        """The present phase of the mission."""
        return self._phase

    @property
    def since_ns(self) -> int:
        """When the present phase began."""
        return self._since_ns

    @property
    def role(self) -> str:
        """The role of this platform in the mission."""
        return self._run.role if self._run else ""

    @property
    def members(self) -> tuple[Member, ...]:
        """Members of the ensemble of the present or last run."""
        return self._run.members if self._run else ()

    @property
    def epoch(self) -> int:
        """Epoch of the present or last run; 0 without one."""
        return self._run.epoch if self._run else 0

    @property
    def unmet(self) -> tuple[str, ...]:
        """Requirements that did not hold at the last evaluation."""
        return self._requirements.unmet

    @property
    def rows(self) -> tuple[ReactionRow, ...]:
        """Reactions of the running mission, which precede the reactions of the platform."""
        return self._run.reactions if self._run and self._phase is MissionPhase.RUNNING else ()

    @property
    def on_link_loss(self) -> str:
        """Policy of the running mission for a lost link, or "" for the policy of the platform."""
        return self._run.mission.on_link_loss if self._run and self._phase is MissionPhase.RUNNING else ""

    def state(self) -> MissionState:
        """The state that the platform publishes on its board."""
        player, barriers, run = self._player, self._barriers, self._run
        moving = max(self._ratios.values(), default=0.0)
        blocks = len(run.mission.blocks) if run and self.playing == run.name else 1
        ratio = min(1.0, player.progress_ratio + moving / blocks) if player else 0.0
        return MissionState(
            epoch=run.epoch if run else 0,
            hash=run.hash[:HASH_DIGITS] if run else "",
            state=self._phase,
            active=player.active if player else (),
            arrivals=barriers.arrivals if barriers else (),
            meetings=barriers.results if barriers else (),
            progress_ratio=1.0 if self._phase is MissionPhase.DONE else round(ratio, 3),
            text=self._text,
            mission=self.playing,
            held_by=self._commons.held_by,
        )

    @property
    def is_beginning(self) -> bool:
        """Whether the instant of the common start is known: the others begin then."""
        decided = self._barriers is not None and self._barriers.has_result(START)
        return self._phase is MissionPhase.READY and decided

    def check(self, run: Run) -> None:
        """Check that the requirements of a mission are met now. Raises: Conflict."""
        watch = RequirementWatch(run.mission.requires, self._lookup, self._delay)
        if missing := watch.missing():
            raise Conflict(f"{self._platform}: requirement {missing!r} is not met")

    def refuse(self, run: Run, reason: str, now_ns: int) -> list[Action]:
        """Records that the mission of a run cannot begin now that its turn has come."""
        self._run, self.playing = run, run.name
        self._withdraw(reason, now_ns)
        return self._settle(now_ns)

    def on_order(self, run: Run, now_ns: int) -> list[Action]:
        """Waits for the common start of a mission, which begins when all members have accepted it.

        Raises: Conflict when a requirement is not met.
        """
        self.check(run)
        self._requirements = RequirementWatch(run.mission.requires, self._lookup, self._delay)
        self._run = run
        self.playing = self._title = run.name
        others = frozenset(member.platform for member in run.members) - {self._platform}
        self._barriers = Barriers(
            self._platform,
            run.members,
            run.epoch,
            round(self._config.lost_after_s * 1e9),
            # the others are taken to be as late as this node
            lambda now_ns: self._lead(others) + TURNS * self._delay.recent_ns(now_ns),
            strict=frozenset({START, *run.strict_barriers()}),
            tolerance_ns=round(run.mission.tolerance_s * 1e9),
        )
        self._await_start(now_ns)
        return self._settle(now_ns)

    def _await_start(self, now_ns: int) -> None:
        if self._barriers is not None:
            self._barriers.arrive(0, BarrierSpec(START, 1, timeout_s=self._config.start_timeout_s), now_ns)
        self._text = "ready"
        self._move(PhaseEvent.ORDER, now_ns)

    def suspend(self, reason: str, now_ns: int) -> list[Action]:
        """Makes way for another mission: stops all blocks, and keeps the marking until `resume`."""
        if self._phase not in {MissionPhase.READY, MissionPhase.RUNNING}:
            return []
        self._text = self.makes_way_for = reason
        is_ready = self._phase is MissionPhase.READY
        self._move(PhaseEvent.SUSPEND, now_ns, reason)
        if is_ready and self._barriers is not None:
            self._barriers.withdraw(0)
        elif self._player is not None:
            self._feed(self._player.suspend(now_ns), now_ns)
        return self._settle(now_ns)

    def resume(self, now_ns: int) -> list[Action]:
        """Continues after `suspend`; a mission that had not begun waits for the common start again."""
        if self._phase is not MissionPhase.SUSPENDED:
            return []
        self.makes_way_for = ""
        if self._player is None:
            self._await_start(now_ns)
        else:
            self._move(PhaseEvent.RESUME, now_ns)
            self._requirements.begin(now_ns, at_once=True)
            self._feed(self._player.resume(now_ns), now_ns)
        return self._settle(now_ns)

    def discard(self, reason: str, now_ns: int) -> list[Action]:
        """Ends a suspended mission, without any effect on the vehicle, which plays another one."""
        if self._phase is MissionPhase.SUSPENDED and self._player is None:
            self._withdraw(reason, now_ns)
        elif self._phase is MissionPhase.SUSPENDED and self._player is not None:
            self._discarded = True
            self._feed(self._player.stop(PlayResult.ABORTED, reason, now_ns), now_ns)
        return self._settle(now_ns)

    def on_states(
        self, states: Iterable[tuple[str, MissionState, tuple[BarrierResult, ...]]], now_ns: int
    ) -> list[Action]:
        """States of several platforms were received at the same instant."""
        if self._barriers is not None:
            for platform, state, results in states:
                self._barriers.on_state(platform, state, results, now_ns)
        return self._settle(now_ns)

    def on_alive(self, platform: str, now_ns: int) -> list[Action]:
        """A platform has a route, even if its mission state was lost."""
        if self._barriers is not None:
            self._barriers.on_alive(platform, now_ns)
        return []

    def on_ended(self, token: int, result: BlockOutcome, text: str, now_ns: int) -> list[Action]:
        """A functional block has ended."""
        self._ratios.pop(token, None)
        if self._player is not None:
            self._feed(self._player.on_ended(token, result, now_ns, text), now_ns)
        return self._settle(now_ns)

    def report(self, token: int, ratio: float, text: str) -> None:
        """A functional block reports its progress."""
        self._ratios[token] = min(max(ratio, 0.0), 1.0)
        self._text = text

    def on_abort(self, reason: str, then: str, now_ns: int) -> list[Action]:
        """Stops the mission, then plays the built-in mission `then`, or by default its `on_failure`.

        Raises: Conflict when this platform has no such built-in mission.
        """
        if then and self._built_in and then not in self._built_in:
            raise Conflict(f"built-in mission {then!r}: unknown; expected {', '.join(self._built_in)}")
        self._stop(PlayResult.ABORTED, reason, then, now_ns, ordered=True)
        return self._settle(now_ns)

    def on_reaction(self, reason: str, action: str, now_ns: int) -> list[Action]:
        """Plays a built-in mission that no operator ordered, unless a stronger one runs or is about to."""
        if action not in self._built_in:
            return []
        doing = {MissionPhase.RECOVERING: self.playing, MissionPhase.ENDING: self._recovery}
        if STRENGTH.get(doing.get(self._phase, ""), 0) < STRENGTH[action]:
            self._stop(PlayResult.ABORTED, reason, action, now_ns)
        elif self._phase is MissionPhase.RECOVERING:
            self._ordered = False
            self._take_vehicle()  # a landing that is held continues
        return self._settle(now_ns)

    def on_manoeuvre(self, name: str, mission: MissionDefinition, reason: str, now_ns: int) -> list[Action]:
        """Stops the mission, then plays a manoeuvre that an operator orders."""
        self._playable[name] = mission
        self._stop(PlayResult.ABORTED, reason, name, now_ns, ordered=True, again=True)
        return self._settle(now_ns)

    def on_control(self, control: ControlState, now_ns: int) -> list[Action]:
        """Takes the driver of the vehicle; the mission is held while a person drives."""
        manual = control.mode is not DriveMode.AUTO
        held_by = (control.holder or control.mode.value) if manual else ""
        if held_by != self._commons.held_by:
            self._commons.held_by = held_by
            if self._phase in PLAYING:
                event = "held" if held_by else "resumed"
                self._step(event, f"driven by {held_by}" if held_by else "")
        if control.mode is DriveMode.HOLD and self._phase is MissionPhase.RECOVERING and not self._ordered:
            # no operator drives any longer: the vehicle is brought to safety after all
            self._actions.append(TakeVehicle(ordered=False))
        return self._settle(now_ns)

    def on_timer(self, now_ns: int) -> list[Action]:
        """Handles time-outs, common times, lost members and requirements."""
        if self._player is not None:
            self._feed(self._player.advance(now_ns), now_ns)
            self._empty_queue(now_ns)
        if self._phase is MissionPhase.RUNNING and (unmet := self._requirements.check(now_ns)):
            self._stop(PlayResult.FAILED, f"requirement {unmet!r} is no longer met", "", now_ns)
        return self._settle(now_ns)

    def deadline_ns(self) -> int | None:
        """When `on_timer` must be called, or None without a deadline."""
        instants = [
            self._player.deadline_ns() if self._player else None,
            self._barriers.deadline_ns() if self._barriers else None,
            self._requirements.due_ns if self._phase is MissionPhase.RUNNING else None,
        ]
        return min((instant for instant in instants if instant is not None), default=None)

    def extend_waits(self, late_ns: int) -> None:
        """Extends the time-outs of the others by the time for which this node did not listen."""
        if self._barriers is not None:
            self._barriers.on_loop_delay(late_ns)

    def _settle(self, now_ns: int) -> list[Action]:
        """Completes the event: processes the queue until it is empty and no wait at a barrier ends."""
        self._empty_queue(now_ns)
        while self._barriers is not None and (passed := self._barriers.advance(now_ns)):
            self._queue.extend(passed)
            self._empty_queue(now_ns)
        actions, self._actions = self._actions, []
        return actions

    def _empty_queue(self, now_ns: int) -> None:
        while self._queue:
            match self._queue.popleft():
                case Passed(0, result, text):  # token 0 is the common start, which no block has
                    self._start(result, text, now_ns)
                case Passed(token, result, text):
                    self._leave_barrier(token, result, text, now_ns)
                case EnterBarrier(token, block, visit):
                    self._enter_barrier(token, block, visit, now_ns)
                case LeaveBarrier(token):
                    self._blocks.pop(token, None)
                    if self._barriers is not None:
                        self._barriers.withdraw(token)
                case PlayEnded(ended, reason):
                    self._end(ended, reason, now_ns)
                case PlaySuspended():
                    self._move(PhaseEvent.STOPPED, now_ns, self.makes_way_for)
                case ProgressStep() as step:
                    if step.event in {STARTED, RESUMED}:
                        self._text = f"{step.block}: {step.type}"
                    self._actions.append(
                        msgspec.structs.replace(step, mission=self.playing, epoch=self.epoch)
                    )
                case StartBlock() | CancelBlock() as action:
                    self._actions.append(action)

    def _feed(self, steps: list[PlayerAction], now_ns: int) -> None:
        """Puts actions of the player at the front of the queue."""
        if self._player is not None and self._player.stopping and self._phase in PLAYING | MAKING_WAY:
            self._move(PhaseEvent.STOP, now_ns)
        self._queue.extendleft(reversed(steps))  # `extendleft` alone would reverse their order

    def _move(self, event: PhaseEvent, now_ns: int, text: str = "") -> None:
        self._phase = follow(self._phase, event)
        self._since_ns = now_ns
        self._step(f"state:{self._phase}", text)

    def _step(self, event: str, text: str = "") -> None:
        """Records a step of the mission as a whole."""
        self._actions.append(ProgressStep("", "Mission", event, text, self.playing, self.epoch))

    def _start(self, result: BlockOutcome, text: str, now_ns: int) -> None:
        run, barriers = self._run, self._barriers
        if run is None or barriers is None or self._phase is not MissionPhase.READY:
            return
        if result != SUCCESS:
            reason = f"not all members are ready: {text}" if text else "not all members are ready"
            self._withdraw(reason, now_ns)
            return
        self._move(PhaseEvent.BEGIN, now_ns)
        barriers.expect_all(now_ns)
        self._requirements.begin(now_ns)
        self._text = "running"
        self._play(run.mission, run.name, now_ns)

    def _play(self, mission: MissionDefinition, name: str, now_ns: int) -> None:
        self.playing = name
        self._ratios = {}
        self._player = Player(mission, self._lookup, self._chance, self._commons.tokens)
        self._feed(self._player.start(now_ns), now_ns)

    def _leave_barrier(self, token: int, result: BlockOutcome, text: str, now_ns: int) -> None:
        block = self._blocks.pop(token, None)
        if block is None or self._player is None:
            return  # another barrier that ended at the same time has ended the mission
        self._feed(self._player.on_ended(token, result, now_ns, text), now_ns)

    def _enter_barrier(self, token: int, block: Block, visit: int, now_ns: int) -> None:
        params = block.params
        if self._barriers is None or not isinstance(params, Barrier):
            return
        quorum = params.quorum if isinstance(params.quorum, int) else None
        self._blocks[token] = block
        self._barriers.arrive(
            token, BarrierSpec(params.id, visit, quorum, params.roles, block.timeout_s), now_ns
        )

    def _stop(
        self,
        result: PlayResult,
        reason: str,
        then: str,
        now_ns: int,
        *,
        ordered: bool = False,
        again: bool = False,
    ) -> None:
        """Ends the mission or built-in mission that is played, then plays another or becomes inactive."""
        self._ordered = ordered
        if self._phase is MissionPhase.RECOVERING and then in {"", self.playing} and not again:
            self._take_vehicle()
            return  # a second order does not begin the same built-in mission again
        if self._phase in PLAYING | MAKING_WAY and self._player is not None:
            self._recovery = then
            self._feed(self._player.stop(result, reason, now_ns), now_ns)
            return
        if self._phase is MissionPhase.ENDING:  # blocks are being cancelled: `_end` plays the newest choice
            self._recovery = then or self._recovery
            return
        if self._phase in {MissionPhase.READY, MissionPhase.SUSPENDED}:
            self._withdraw(reason, now_ns)
        if then in self._playable:
            # no mission runs: only the built-in one is played
            self._verdict, self._reason, self._title = PhaseEvent.DONE, reason, then
            self._recover(then, reason, now_ns)

    def _withdraw(self, reason: str, now_ns: int) -> None:
        """Withdraws an order before its mission has begun: nothing was played, so nothing is aborted."""
        if self._barriers is not None:
            self._barriers.withdraw(0)
        self._text = f"{self.playing} was not started: {reason}"
        self._move(PhaseEvent.WITHDRAWN, now_ns, reason)
        self.playing = ""

    def _end(self, result: PlayResult, reason: str, now_ns: int) -> None:
        """Handles the end of a play: plays a built-in mission or becomes inactive."""
        recovering, self._recovering = self._recovering, False
        recovery, self._recovery = self._recovery, ""
        self._ratios = {}
        if not recovering:  # the end of a built-in mission does not change the result of the mission before
            self._verdict, self._reason = PhaseEvent(result.value), reason or result.value
            recovery = recovery or (
                self._run.mission.on_failure if self._run and result is not PlayResult.DONE else ""
            )
        if recovery in self._playable and not self._discarded:
            self._recover(recovery, reason, now_ns)
            return
        if recovering and result is not PlayResult.DONE:
            # the vehicle could not be brought to safety
            self._verdict, self._reason = (
                PhaseEvent.FAILED,
                f"{self.playing}: {reason}; before: {self._reason}",
            )
        self._text = self._reason
        self.playing = self._title
        self._move(self._verdict, now_ns, self._text)

    def _recover(self, name: str, reason: str, now_ns: int) -> None:
        self._move(PhaseEvent.RECOVER, now_ns, f"{name}: {reason}")
        self._recovering = True
        self._take_vehicle()
        self._play(self._playable[name], name, now_ns)

    def _take_vehicle(self) -> None:
        """Asks for the vehicle, if it is driven by hand."""
        if self._commons.held_by:
            self._actions.append(TakeVehicle(self._ordered))
