"""The stick of a vehicle: asks for it, sends set-points while it has it, releases it."""

import asyncio
import os
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import click
import msgspec

from swarmctl.commands.drive.keyboard import Keyboard, Rates
from swarmctl.session.session import Session
from swarmctl.vehicles.observer import VehicleObserver
from swarmctl.vehicles.selection import kinds
from swarmware.errors import Denied, InvalidInput, NoAnswer, SwarmError
from swarmware.model import names
from swarmware.model.platform_kind import NO_KIND, PlatformKind
from swarmware.transport.delivery.outcome import Outcome
from swarmware.types.control import ControlState, DriveEvent, DriveMode, DriveRequest
from swarmware.types.vehicle import Setpoint

DRIVE: Final = "sys/vehicle/drive"
MANUAL: Final = "cmd/manual"
STATE: Final = "control/state"
PERIOD_S: Final = 0.1
"""Of set-points: two may be lost before the vehicle holds."""
LIFETIME_S: Final = 0.3
"""A set-point that is under way for longer is not carried out any more."""
LOST_S: Final = 0.5
"""Time without an acknowledged set-point after which the link counts as lost."""
UNDER_WAY: Final = 3
"""Maximum set-points without an answer: a slow link must not queue old ones."""
_FOCUS: Final = ("\x1b[?1004h", "\x1b[?1004l")
"""Switches the report of a lost focus of a terminal on and off."""


class HandDriven(msgspec.Struct, frozen=True):
    """End of driving a vehicle by hand."""

    platform: str
    mode: DriveMode
    """Mode of the vehicle after it."""
    state: str
    """Last state of the vehicle: holding 3.1 m armed."""
    sent: int
    """Set-points that were sent."""
    delivered: int
    """Number of set-points that the vehicle acknowledged."""
    text: str = ""
    """Reason for which it ended before the operator released the vehicle."""


class Stick:
    """The stick of one vehicle, from its request to its release."""

    def __init__(self, session: Session, platform: str, granted: ControlState) -> None:
        self._session = session
        self._platform = platform
        self._granted = granted
        self._board = session.module.reader(names.join(platform, STATE), ControlState)
        self._waits: set[asyncio.Task[None]] = set()
        self._delivered_ns = session.module.now_ns()
        self.sent = 0
        self.delivered = 0

    @classmethod
    async def request(cls, session: Session, platform: str, *, take: bool) -> "Stick":
        """Asks for the stick of a vehicle.

        Raises: Denied with the name of who has it, NotFound, NoAnswer.
        """
        return cls(session, platform, await _ask(session, platform, DriveRequest(DriveEvent.DRIVE, take)))

    @property
    def state(self) -> ControlState:
        """Newest known state; never one from before the stick was given."""
        state = self._board.value
        return self._granted if state is None or state.since_ns < self._granted.since_ns else state

    @property
    def lost(self) -> str:
        """Why this operator lost the stick, or "" while having it."""
        state = self.state
        if state.holder_id == self._granted.holder_id:
            return ""
        if state.mode is DriveMode.PILOT:
            return "the safety pilot drives now"
        return (
            f"{state.holder} has taken the stick" if state.holder else f"mode {state.mode} by {state.event}"
        )

    @property
    def silent_s(self) -> float:
        """Time since the vehicle acknowledged a set-point."""
        return (self._session.module.now_ns() - self._delivered_ns) / 1e9

    def send(self, setpoint: Setpoint) -> None:
        """Sends a set-point, unless too many are under way."""
        # a skipped one is not sent later: the next period has a newer set-point
        if len(self._waits) < UNDER_WAY:
            self.sent += 1
            task = asyncio.get_running_loop().create_task(self._send(setpoint))
            self._waits.add(task)
            task.add_done_callback(self._waits.discard)

    async def _send(self, setpoint: Setpoint) -> None:
        module = self._session.module
        path = names.join(self._platform, MANUAL)
        outcome: Outcome = await module.send(path, setpoint, timeout_s=LIFETIME_S, urgent=True)
        if outcome.delivered:
            self.delivered += 1
            self._delivered_ns = module.now_ns()

    async def release(self) -> ControlState:
        """Gives the vehicle to the navigator, unless another one has taken it.

        Raises: NoAnswer when the vehicle is out of reach: then it holds.
        """
        for task in list(self._waits):
            task.cancel()
        # a release would take the stick from the operator who has it now
        if self.lost:
            return self.state
        try:
            return await _ask(self._session, self._platform, DriveRequest(DriveEvent.RELEASE))
        # another operator took it just before
        except Denied:
            return self.state


async def _ask(session: Session, platform: str, request: DriveRequest) -> ControlState:
    path = names.join(platform, DRIVE)
    try:
        return await session.module.request(
            path, request, ControlState, timeout_s=session.settings.timeout_s, urgent=True
        )
    except NoAnswer as error:
        raise NoAnswer(f"{platform} does not answer: {error}") from error


@contextmanager
def raw_terminal() -> Iterator[int]:
    """The descriptor of stdin, which reports each key at once; Ctrl-C is a key.

    Raises: UsageError when stdin is not a terminal.
    """
    if not sys.stdin.isatty():
        raise click.UsageError("drive reads the keyboard: expected a terminal as stdin")
    descriptor = sys.stdin.fileno()
    former = termios.tcgetattr(descriptor)
    raw = termios.tcgetattr(descriptor)
    raw[3] &= ~(termios.ICANON | termios.ECHO)
    # without a signal: Ctrl-C must release the vehicle first
    raw[6][termios.VINTR] = b"\x00"
    termios.tcsetattr(descriptor, termios.TCSADRAIN, raw)
    # a lost focus stops the vehicle at once, before the time of a held key is over
    sys.stderr.write(_FOCUS[0])
    sys.stderr.flush()
    try:
        yield descriptor
    finally:
        sys.stderr.write(_FOCUS[1])
        sys.stderr.flush()
        # flushed: keys typed meanwhile must not become commands of the shell
        termios.tcsetattr(descriptor, termios.TCSAFLUSH, former)


async def drive_by_hand(session: Session, platform: str, rates: Rates, *, take: bool) -> None:
    """`swarmctl drive` from the request for the stick to its release.

    Raises: as `raw_terminal` and `Stick.request`; SwarmError when another one took the vehicle.
    """
    await session.reach(platform)
    kind = (await kinds(session)).get(platform, NO_KIND)
    if kind == PlatformKind.GCS:
        raise InvalidInput(f"{platform}: a ground station; expected a vehicle")
    keyboard = Keyboard(rates, sideways=kind == PlatformKind.UAV)
    observer = VehicleObserver(session, {platform: kind})
    with raw_terminal() as descriptor:
        stick = await Stick.request(session, platform, take=take)
        reason = ""
        try:
            reason = await _drive(session, platform, stick, keyboard, observer, descriptor)
        finally:
            # also after an error: a vehicle must not wait for an operator who has gone
            state = await stick.release()
    words = observer.snapshot(platform).words()
    if session.settings.structured:
        session.out.document(HandDriven(platform, state.mode, words, stick.sent, stick.delivered, reason))
    else:
        session.out.now(f"{platform} {words}, mode {state.mode}")
    if reason:
        raise SwarmError(f"drive: {platform}: {reason}")


async def _drive(
    session: Session,
    platform: str,
    stick: Stick,
    keyboard: Keyboard,
    observer: VehicleObserver,
    descriptor: int,
) -> str:
    """Sends set-points until the operator releases the vehicle; the reason of another end."""
    loop = asyncio.get_running_loop()

    def read() -> None:
        data = os.read(descriptor, 256)
        # no bytes mean that the terminal was closed, which counts as Ctrl-D
        keyboard.on_text(data.decode(errors="replace") or "\x04", loop.time())

    loop.add_reader(descriptor, read)
    try:
        async for _ in session.module.every(PERIOD_S):
            if keyboard.ended:
                return ""
            if reason := stick.lost:
                return reason
            setpoint = keyboard.setpoint(loop.time())
            stick.send(setpoint)
            if not session.settings.structured:
                session.out.redraw(
                    line(platform, stick.state, stick.silent_s, observer.snapshot(platform).words(), setpoint)
                )
    finally:
        loop.remove_reader(descriptor)
    return ""


def line(platform: str, state: ControlState, silent_s: float, words: str, setpoint: Setpoint) -> str:
    """The line on the screen: mode, age of the newest acknowledgement, vehicle, set-point."""
    link = (
        f"answered {silent_s:.1f} s ago" if silent_s < LOST_S else f"NO ANSWER for {silent_s:.1f} s: it holds"
    )
    moves = f"forward {setpoint.vx_m_s:+.1f} left {setpoint.vy_m_s:+.1f} up {setpoint.vz_m_s:+.1f} m/s"
    return (
        f"{platform} {state.mode} · {link} · {words} · {moves} turn {setpoint.wz_rad_s:+.1f} rad/s · x ends"
    )
