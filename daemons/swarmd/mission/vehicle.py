"""The blocks' interface to the vehicle: motors, one goal at a time, status of the navigator."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from swarmd.mission.config import Config
from swarmd.mission.core.nav_fault import NavFaultTimeouts
from swarmd.mission.home import Home
from swarmware.errors import Denied, NoAnswer, NotFound, SwarmError
from swarmware.mission.plugin import BlockError
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.control import ControlState, DriveEvent, DriveMode, DriveRequest
from swarmware.types.navigation import Goal, GoalKind, NavError, NavState, NavStatus
from swarmware.types.vehicle import ArmRequest, Pose, VehicleState

Settled = Callable[[NavStatus], bool]
Progress = Callable[[NavStatus], None]

ARM_PATH = "sys/vehicle/arm"
CONTROL_PATH = "control/state"
DRIVE_PATH = "sys/vehicle/drive"
ARM_S = 6.0
"""Time-out of arming: the vehicle waits up to 3 s until it is ready, its chassis 1 s for its answer."""


class VehicleClient:
    """Writes `nav/goal`, follows `nav/status`, requests arming."""

    def __init__(
        self,
        module: Module,
        config: Config,
        goal: BoardWriter[Goal],
        status: BoardReader[NavStatus],
        state: BoardReader[VehicleState],
        pose: BoardReader[Pose],
        home: Home,
        control: BoardReader[ControlState],
    ) -> None:
        self._module = module
        self._config = config
        self._goal = goal
        self._status = status
        self._state = state
        self._pose = pose
        self._home = home
        self.control = control
        """Mode of the vehicle, and its driver."""
        self._limits_s = {
            NavError.NONE: config.blocked_patience_s,
            NavError.NO_WAY: config.blocked_patience_s,
            NavError.LEADER_LOST: config.leader_patience_s,
            NavError.NO_POSITION: config.position_patience_s,
        }
        # a restarted daemon must not reuse a number that the navigator has seen
        self._seq = module.now_ns() // 1_000_000 & 0x7FFF_FFFF

    @classmethod
    def open(cls, module: Module, config: Config) -> "VehicleClient":
        """Opens the writer of the goal and the reader of the navigator's status."""
        goal = module.writer(
            "nav/goal", Goal, log="all", description="Goal that the navigator reaches or keeps"
        )
        status = module.reader("nav/status", NavStatus)
        state = module.reader("vehicle/state", VehicleState)
        pose = module.reader("nav/pose", Pose)
        home = Home.open(module, pose)
        module.start(home.follow(), "home")
        control = module.reader(CONTROL_PATH, ControlState)
        return cls(module, config, goal, status, state, pose, home, control)

    @property
    def flies(self) -> bool:
        """Whether the vehicle can fly."""
        return self._module.node.config.kind == PlatformKind.UAV

    @property
    def home(self) -> Pose | None:
        """The place where the vehicle was armed, or None if unknown."""
        return self._home.place

    @property
    def pose(self) -> Pose:
        """The position, as last received.

        Raises: BlockError no_position when none was received.
        """
        pose = self._pose.value
        if pose is None:
            raise BlockError("no_position", "its position is not known")
        return pose

    @property
    def last_pose(self) -> Pose | None:
        """The position as last received, or None before the first position."""
        return self._pose.value

    @property
    def height_m(self) -> float:
        """Height above the map's origin, as last received.

        Raises: BlockError no_position when none was received.
        """
        return self.pose.z_m

    @property
    def landed(self) -> bool:
        """Whether the vehicle is on the ground, as last received."""
        state = self._state.value
        return state is not None and state.landed

    @property
    def armed(self) -> bool:
        """Whether the motors are armed, as last received."""
        state = self._state.value
        return state is not None and state.armed

    @property
    def held(self) -> bool:
        """Whether a person drives by hand: the navigator does not move the vehicle."""
        control = self.control.value
        return control is not None and control.mode is not DriveMode.AUTO

    async def take(self, *, ordered: bool) -> None:
        """Asks for the vehicle, which is driven by hand.

        Raises: Denied with the name of the driver, NoAnswer, NotFound.
        """
        event = DriveEvent.ORDER if ordered else DriveEvent.RECOVERY
        await self._module.request(DRIVE_PATH, DriveRequest(event), ControlState)

    async def arm(self, armed: bool, *, force: str = "") -> None:
        """Arms or disarms the motors, and waits until the vehicle reports it.

        `force`: who forces the arming of a vehicle that is not ready, and why, or "" if it is refused.
        Raises: BlockError refused or no_vehicle.
        """
        order, was_armed = ArmRequest(armed, bool(force), force), self.armed
        try:
            state = await self._module.request(ARM_PATH, order, VehicleState, timeout_s=ARM_S)
            while state.armed != armed:
                state = await self._state.changed()
        except asyncio.CancelledError:
            if armed and not was_armed:
                # the order may still wait until the vehicle is ready, and would arm it for no mission
                self._module.start(self._withdraw_arming(), "withdraw an arming")
            raise
        except (NotFound, NoAnswer) as error:
            raise BlockError("no_vehicle", str(error)) from error
        except Denied as error:
            raise BlockError("refused", str(error)) from error
        except SwarmError as error:
            raise BlockError("refused", f"{type(error).__name__}: {error}") from error

    async def _withdraw_arming(self) -> None:
        reason = "the arming was cancelled"
        with suppress(SwarmError):
            await self._module.request(ARM_PATH, ArmRequest(False, reason=reason), VehicleState)

    def command(self, kind: GoalKind, **fields: Any) -> int:
        """Sends the navigator a new goal; returns its number."""
        self._seq += 1
        self._goal.write(Goal(self._seq, kind, **fields))
        return self._seq

    async def goto(
        self,
        x_m: float,
        y_m: float,
        z_m: float,
        *,
        speed_m_s: float = 1.5,
        yaw_rad: float | None = None,
        progress: Progress | None = None,
    ) -> None:
        """Moves to a position and waits until it is reached; any other end commands hold.

        Raises: BlockError blocked, disarmed, no_position or no_navigator.
        """
        await self.move(
            GoalKind.GOTO,
            arrived,
            progress or (lambda status: None),
            x_m=x_m,
            y_m=y_m,
            z_m=z_m,
            yaw_rad=yaw_rad,
            speed_m_s=speed_m_s,
        )

    async def move(
        self, kind: GoalKind, settled: Settled, progress: Progress, *, settle_s: float = 0.0, **fields: Any
    ) -> None:
        """Sends a goal and waits until it is reached and kept; any other end commands hold.

        Raises: BlockError blocked, disarmed, leader_lost, no_position or no_navigator.
        """
        seq = self.command(kind, **fields)
        reached = False
        try:
            await self._reach(seq, settled, progress, settle_s)
            reached = True
        finally:
            # the vehicle must not continue without a block, unless another motion has replaced the goal
            if not reached and self._seq == seq:
                self.command(GoalKind.HOLD)

    async def _reach(self, seq: int, settled: Settled, progress: Progress, settle_s: float) -> None:
        timeouts = NavFaultTimeouts(self._limits_s)
        there_ns: int | None = None
        wait_s = self._config.navigator_timeout_s
        received_ns = self._module.now_ns()
        while True:
            try:
                status = await self._status.changed(wait_s)
            except NoAnswer as error:
                silent_s = (self._module.now_ns() - received_ns) / 1e9
                raise BlockError("no_navigator", f"no answer to goal {seq} for {silent_s:.1f} s") from error
            now_ns = self._module.now_ns()
            if status.goal_seq > seq:
                raise BlockError("blocked", f"another goal ({status.goal_seq}) has replaced {seq}")
            if status.goal_seq < seq:  # a status before the new goal does not extend the time-out
                wait_s = max(0.0, self._config.navigator_timeout_s - (now_ns - received_ns) / 1e9)
                continue
            received_ns, wait_s = now_ns, self._config.navigator_timeout_s
            if self.held:
                # a person may drive for any time: the motion continues afterwards, without an error
                timeouts.reset()
                there_ns = None
                continue
            progress(status)
            if (lost := timeouts.lost(status, now_ns)) is not None:
                raise BlockError(*lost)
            if not settled(status):
                there_ns = None
                continue
            there_ns = now_ns if there_ns is None else there_ns
            if now_ns - there_ns >= settle_s * 1e9:
                return


def arrived(status: NavStatus) -> bool:
    """Whether the vehicle has reached its goal."""
    return status.state is NavState.ARRIVED


class Way:
    """Progress on a way, relative to the longest distance that was reported."""

    def __init__(self) -> None:
        self._length_m = 0.0

    def ratio(self, status: NavStatus) -> float:
        """Share of the way that is done."""
        self._length_m = max(self._length_m, status.distance_m, 1e-3)
        return 1.0 - status.distance_m / self._length_m
