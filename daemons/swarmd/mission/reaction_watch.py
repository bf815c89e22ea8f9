"""Reactions of this vehicle: reads the resources of the rows, and feeds what they cause to the executor."""

import asyncio
import logging
from collections.abc import Callable
from typing import Final

from swarmd.mission.config import Config
from swarmd.mission.core.reactions import React, ReactionTable, RowChanged, Situation, link_loss_row
from swarmd.mission.core.run import Action, ProgressStep
from swarmd.mission.core.scheduler import MissionScheduler
from swarmd.mission.core.way_home import WayHomeEstimate
from swarmd.mission.values import Values
from swarmd.mission.vehicle import VehicleClient
from swarmware.errors import SwarmError
from swarmware.mission import vocabulary
from swarmware.mission.condition_parser import parse
from swarmware.mission.reaction import STORED
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.runtime.instant import until
from swarmware.service.live_config import LiveConfig
from swarmware.types.reaction import MissionWatch, ReactionPhase, Reactions, ReactionState, WayHome
from swarmware.types.vehicle import BatteryState

log = logging.getLogger("swarm.mission")

ARMED_NS: Final = 250_000_000
"""Period of evaluating the rows while the vehicle is armed."""
REST_NS: Final = 1_000_000_000
"""Period of evaluating the rows while it is disarmed, and of estimates that change slowly."""


class ReactionWatch:
    """Evaluates the rows, and publishes their state."""

    def __init__(
        self,
        module: Module,
        live: LiveConfig[Config],
        config: Config,
        values: Values,
        vehicle: VehicleClient,
        core: MissionScheduler,
        feed: Callable[[list[Action]], None],
        order: Callable[[str, int, str], None],
    ) -> None:
        """`feed`: carries out actions of the core.

        `order`: starts a stored mission, with its priority and the reason.
        """
        self._module = module
        self._live = live
        self._config = config
        self._values = values
        self._vehicle = vehicle
        self._core = core
        self._feed = feed
        self._order = order
        self._table = ReactionTable()
        self._notes: dict[str, str] = {}
        self._slow_period = -1
        """Number of the period of the last slow evaluation."""
        self._way_home = WayHomeEstimate(config.home_reserve_ratio)
        self._battery: BoardReader[BatteryState] = module.reader("power/battery", BatteryState)
        self._station: bool | None = None
        """Whether a ground station is in reach, or None before the first contact with a station."""
        self._restarted = vehicle.armed
        """True if the vehicle was armed when this daemon began, until it is disarmed."""
        self._watch_board = module.writer(
            "mission/watch", MissionWatch, log="all", description="Observations of the mission daemon"
        )
        self._way_board = module.writer(
            "vehicle/way_home", WayHome, log="all", description="Charge for the way to the place of arming"
        )
        self._board = module.writer(
            "mission/reactions", Reactions, log="all", description="State of the reactions to faults"
        )
        self._watched = MissionWatch(None, self._restarted)
        self._watch_board.write(self._watched)
        self._set_rows()
        self._written = self.state
        self._board.write(self._written)

    @property
    def state(self) -> Reactions:
        """State of all rows."""
        return Reactions(self._table.states())

    def check_order(self, order: str) -> None:
        """Check that no lasting reaction forbids an order.

        Raises: Conflict with its reason.
        """
        self._table.check_order(order)

    def on_stations(self, reached: bool) -> None:
        """Takes whether a ground station is in reach now."""
        # a vehicle that never had a station has not lost one: the row of a lost link must not act
        if reached or self._station is not None:
            self._station = reached

    async def run(self) -> None:
        """Evaluates the rows until cancelled."""
        # it reads all templates, for which the event loop should not wait
        await asyncio.to_thread(self._check_rows)
        while True:
            self._look()
            period_ns = ARMED_NS if self._vehicle.armed else REST_NS
            await until(self._module.clock, (self._module.now_ns() // period_ns + 1) * period_ns)

    def _check_rows(self) -> None:
        """Names the rows of the platform that can never act."""
        try:
            known = vocabulary.shipped()
        except SwarmError as error:
            log.warning("reactions: not checked: %s", error)
            return
        for row in self._config.reaction:
            for text in filter(None, (row.when, row.possible)):
                for problem in known.examine(parse(text)):
                    if problem.severity == "error":
                        # noted, not refused: an error in one row must not take the other reactions
                        self._notes[row.name] = problem.message
                        log.error("reaction %s can never act: %s", row.name, problem.message)

    def _set_rows(self) -> None:
        config = self._config
        link = link_loss_row(self._core.on_link_loss or config.link_loss, config.link_loss_s)
        self._table.set_rows([*self._core.rows, link, *config.reaction], self._notes)

    def _look(self) -> None:
        now_ns = self._module.now_ns()
        vehicle = self._vehicle
        self._config = self._live.take() or self._config  # the tree waits for it when an operator sets one
        # by the number of the period, because two looks may be a little less than a period apart
        if (period := now_ns // REST_NS) != self._slow_period:
            self._slow_period = period
            self._look_slowly(now_ns)
        self._watch()
        self._set_rows()
        situation = Situation(vehicle.armed, vehicle.flies and not vehicle.landed, self._core.orders)
        for action in self._table.on_look(self._values, situation, now_ns):
            match action:
                case RowChanged(state, values):
                    self._record(state, values)
                    if state.phase is not ReactionPhase.ACTIVE:
                        self._feed(self._core.on_reaction_over(state.row, now_ns))
                case React(row, then, reason) if then == STORED:
                    self._order(row.mission, row.priority, reason)
                case React(row, then, reason) if action.suspends:
                    self._feed(self._core.on_interruption(row.name, reason, then, now_ns))
                case React(_, then, reason):
                    self._feed(self._core.on_reaction(reason, then, now_ns))
        if self.state != self._written:
            self._written = self.state
            self._board.write(self._written)

    def _record(self, state: ReactionState, values: str) -> None:
        """Records that a row has become active or idle, with the values that caused it."""
        active = state.phase is ReactionPhase.ACTIVE
        event = f"active:{state.action}" if active else "ended"
        text = "; ".join(filter(None, (state.reason, values)))
        log.warning("reaction %s: %s %s", state.row, event, text)
        self._feed([ProgressStep(f"@{state.row}", "Reaction", event, text)])

    def _watch(self) -> None:
        """Publishes the observations of this daemon: stations in reach, and its own restart in flight."""
        self._restarted = self._restarted and self._vehicle.armed
        watched = MissionWatch(self._station, self._restarted)
        if watched != self._watched:
            self._watched = watched
            self._watch_board.write(watched)

    def _look_slowly(self, now_ns: int) -> None:
        """Opens readers of resources that have appeared, and estimates the way home."""
        self._values.open(self._table.resources())
        vehicle, battery = self._vehicle, self._battery.value
        if not vehicle.armed or battery is None:
            self._way_home.on_disarmed()
            return
        self._way_home.on_charge(battery.remaining_ratio, now_ns)
        pose, home = vehicle.last_pose, vehicle.home
        if pose is None or home is None:
            return
        if (estimate := self._way_home.estimate(pose, home, flies=vehicle.flies)) is not None:
            self._way_board.write(estimate)
