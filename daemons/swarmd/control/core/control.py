"""The core of control: set-points, requests and the switch in; commands to the chassis and the mode out."""

import math
from typing import Final

import msgspec

from swarmd.control.config import Config
from swarmd.control.core.modes import DECISIONS, TRANSITIONS, Decision, Source
from swarmware.errors import Denied, InvalidInput
from swarmware.runtime.core import AT_ONCE
from swarmware.types.control import ControlState, Drive, DriveEvent, DriveMode, DriveRequest
from swarmware.types.vehicle import Setpoint, VehicleMode

HOLD_NS: Final = 200_000_000
"""Period of commands to a vehicle that holds; less than half of the time-out of the chassis."""
NO_HOLDER: Final = ""
_REQUESTED: Final = (DriveEvent.DRIVE, DriveEvent.RELEASE, DriveEvent.ORDER, DriveEvent.RECOVERY)


class Operator(msgspec.Struct, frozen=True):
    """An operator's application: its id, and its name for others."""

    id: int
    name: str


class WriteDrive(msgspec.Struct, frozen=True, gc=False):
    """Action: command the chassis, with the stamp of the set-point from which the command was made."""

    drive: Drive
    stamp_ns: int


class PublishMode(msgspec.Struct, frozen=True):
    """Action: publish the mode and the holder of the stick."""

    state: ControlState


Action = WriteDrive | PublishMode


class ControlCore:
    """Decides whose set-points reach the chassis.

    In mode auto no command replaces the missing set-points of a silent navigator, because the chassis has
    its own time-out.
    """

    def __init__(self, config: Config, former: ControlState | None = None) -> None:
        """`former`: state that the previous run published; a vehicle that was driven by hand then holds."""
        self._timeout_ns = round(config.manual_timeout_s * 1e9)
        self._config = config
        self._state = ControlState(DriveMode.AUTO)
        # the operator of the previous run may be gone, so manual driving becomes a hold
        if former is not None and former.mode.known:
            manual = former.mode is DriveMode.MANUAL
            self._state = msgspec.structs.replace(former, mode=DriveMode.HOLD) if manual else former
        self._manual_ns = 0
        """Stamp of the newest manual set-point, or the instant at which the operator received the stick."""
        self._sticks_ns: int | None = None
        """Stamp of the pilot's newest set-point, or None if there was none since the switch was moved."""
        self._hold_ns = AT_ONCE
        self.expired = 0
        """Manual set-points that were too old when they arrived."""
        self.refused = 0
        """Manual set-points of applications that did not have the stick."""

    @property
    def state(self) -> ControlState:
        """The mode and the holder of the stick."""
        return self._state

    def on_setpoint(self, setpoint: Setpoint, stamp_ns: int, now_ns: int) -> list[Action]:
        """Takes a set-point of the navigator."""
        if DECISIONS[self._state.mode, Source.NAVIGATOR] is not Decision.PASS:
            return []
        drive = Drive(
            setpoint.vx_m_s,
            setpoint.vy_m_s,
            setpoint.vz_m_s,
            setpoint.wz_rad_s,
            self._state.mode,
            Source.NAVIGATOR.value,
        )
        return [WriteDrive(drive, stamp_ns)]

    def on_manual(self, setpoint: Setpoint, sender_id: int, stamp_ns: int, now_ns: int) -> list[Action]:
        """Takes a manual set-point, stamped by its sender, in the own clock."""
        state = self._state
        if sender_id != state.holder_id or DECISIONS[state.mode, Source.OPERATOR] is not Decision.PASS:
            self.refused += 1
            return []
        # a stamp in the future, of a clock that is ahead, would extend the validity
        stamp_ns = min(stamp_ns, now_ns)
        if now_ns - stamp_ns > self._timeout_ns:
            self.expired += 1
            return []
        # messages may overtake each other on different routes
        if stamp_ns <= self._manual_ns:
            return []  # a newer set-point arrived before
        self._manual_ns = stamp_ns
        actions = self._move(DriveEvent.SETPOINT, state.holder, state.holder_id, now_ns)
        drive = self._limited(setpoint)
        return [*actions, WriteDrive(drive, stamp_ns)]

    def on_sticks(self, setpoint: Setpoint, stamp_ns: int, now_ns: int) -> list[Action]:
        """Takes a set-point of the safety pilot's sticks."""
        if DECISIONS[self._state.mode, Source.PILOT] is not Decision.PASS:
            return []
        if now_ns - stamp_ns > self._timeout_ns:
            self.expired += 1
            return []
        self._sticks_ns = stamp_ns
        return [WriteDrive(self._limited(setpoint), stamp_ns)]

    def on_request(self, request: DriveRequest, operator: Operator, now_ns: int) -> list[Action]:
        """Takes a request for the stick, or for the navigator.

        Raises: Denied with the name of the source that drives, InvalidInput for any other event.
        """
        event, state = request.event, self._state
        if event not in _REQUESTED:
            raise InvalidInput(f"event {str(event)!r}: expected one of {', '.join(_REQUESTED)}")
        mine = state.holder_id == operator.id
        if event is DriveEvent.RELEASE and state.holder_id and not mine:
            raise Denied(f"release: {state.holder} has the stick; expected its own request")
        if TRANSITIONS[state.mode, event] is None:
            raise Denied(f"{event}: {self._who()}")
        if event is DriveEvent.DRIVE:
            if state.holder_id and not mine and not request.take:
                raise Denied(f"drive: {self._who()}; --take takes the stick")
            # the operator has one time-out to send the first set-point; the vehicle stops meanwhile
            self._manual_ns = now_ns
            actions = self._move(event, operator.name, operator.id, now_ns)
            return [*actions, WriteDrive(self._limited(Setpoint(0.0)), now_ns)]
        return self._move(event, NO_HOLDER, 0, now_ns)

    def on_switch(self, position: VehicleMode, now_ns: int) -> list[Action]:
        """Takes the position of the safety pilot's switch; an unknown position gives the pilot control."""
        auto = position is VehicleMode.AUTO
        event = DriveEvent.SWITCH_AUTO if auto else DriveEvent.SWITCH_MANUAL
        # the switch is published repeatedly
        if TRANSITIONS[self._state.mode, event] is self._state.mode:
            return []
        return [*self._move(event, NO_HOLDER, 0, now_ns), *self.on_timer(now_ns)]

    def on_timer(self, now_ns: int) -> list[Action]:
        """Ends manual driving whose set-points have expired, and repeats the command to hold."""
        state, actions = self._state, list[Action]()
        if state.mode is DriveMode.MANUAL and now_ns - self._manual_ns >= self._timeout_ns:
            actions += self._move(DriveEvent.EXPIRED, state.holder, state.holder_id, now_ns)
        if self._sticks_ns is not None and now_ns - self._sticks_ns >= self._timeout_ns:
            # the transmitter is silent: the vehicle holds until its sticks are received again
            self._sticks_ns = None
            self._hold_ns = AT_ONCE
        if self._holds and now_ns >= self._hold_ns:
            self._hold_ns = now_ns + HOLD_NS
            actions.append(WriteDrive(Drive(0.0, mode=self._state.mode), now_ns))
        return actions

    def deadline_ns(self) -> int | None:
        """Instant at which set-points expire or the command to hold is repeated, or None in mode auto."""
        if self._state.mode is DriveMode.MANUAL:
            return self._manual_ns + self._timeout_ns
        if self._sticks_ns is not None:
            return self._sticks_ns + self._timeout_ns
        return self._hold_ns if self._holds else None

    @property
    def _holds(self) -> bool:
        mode = self._state.mode
        return mode is DriveMode.HOLD or (mode is DriveMode.PILOT and self._sticks_ns is None)

    def _move(self, event: DriveEvent, holder: str, holder_id: int, now_ns: int) -> list[Action]:
        mode = TRANSITIONS[self._state.mode, event]
        if mode is None:
            raise Denied(f"{event}: {self._who()}")
        if mode is self._state.mode and holder_id == self._state.holder_id:
            return []
        if mode is not self._state.mode:
            self._hold_ns = AT_ONCE
            self._sticks_ns = None
        self._state = ControlState(mode, holder, holder_id, now_ns, event.value)
        return [PublishMode(self._state)]

    def _who(self) -> str:
        match self._state.mode:
            case DriveMode.PILOT:
                return "the safety pilot drives, the switch of the vehicle is at manual"
            case DriveMode.AUTO:
                return "the navigator drives"
            case _:
                return f"{self._state.holder} has the stick"

    def _limited(self, setpoint: Setpoint) -> Drive:
        config, pilot = self._config, self._state.mode is DriveMode.PILOT
        speed = math.hypot(setpoint.vx_m_s, setpoint.vy_m_s)
        # scaled in common, so that the limit does not change the direction
        ratio = min(1.0, config.speed_max_m_s / speed) if speed > 0.0 else 1.0
        return Drive(
            setpoint.vx_m_s * ratio,
            setpoint.vy_m_s * ratio,
            _clipped(setpoint.vz_m_s, config.climb_max_m_s),
            _clipped(setpoint.wz_rad_s, config.turn_max_rad_s),
            DriveMode.PILOT if pilot else DriveMode.MANUAL,
            Source.PILOT.value if pilot else self._state.holder,
        )


def _clipped(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
