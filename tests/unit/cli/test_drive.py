"""Driving by hand at the terminal: keys as set-points, the stick, takeoff and goto, what counts as done."""

import asyncio
from types import SimpleNamespace
from typing import Any

import click
import msgspec
import pytest
from click.testing import CliRunner
from tests.unit.cli.session import ScriptedSession
from tests.unit.cli.sights import DOWN, UP, sight

from swarmctl.commands.drive.keyboard import FIRST_S, REPEAT_S, Keyboard, Rates, keys_in
from swarmctl.commands.drive.stick import UNDER_WAY, Stick, drive_by_hand, line
from swarmctl.commands.manoeuvre import requests
from swarmctl.commands.manoeuvre.command import Place
from swarmctl.main import cli
from swarmctl.session.session import Session
from swarmctl.vehicles import manoeuvre
from swarmctl.vehicles.snapshot import VehicleSnapshot, arrived_at, risen_to
from swarmware.errors import Denied, InvalidInput, NoAnswer, Partial
from swarmware.model.platform_kind import PlatformKind
from swarmware.testing.client import FakeClient
from swarmware.transport.delivery.outcome import Outcome
from swarmware.types.control import ControlState, DriveEvent, DriveMode, DriveRequest
from swarmware.types.mission import ManoeuvreRequest
from swarmware.types.vehicle import Pose, Setpoint

RATES = Rates(2.0, 0.5, 0.4)
MINE = ControlState(DriveMode.MANUAL, "operator@gcs", 7, 1000, "drive")


# -- keyboard


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        ("wW", ["w", "w"]),
        ("\x1b[A\x1b[B\x1b[C\x1b[D", ["w", "s", "d", "a"]),
        ("\x1bOA", ["w"]),
        ("\x1b[O\x1b[I", ["\x1b[O", "\x1b[I"]),
        ("\x1b[5~r", ["\x1b[5~", "r"]),
        ("\x1b", ["\x1b"]),
        ("é\n", ["é", "\n"]),
        ("", []),
    ],
)
def test_what_a_terminal_sends_is_read_as_keys(text: str, keys: list[str]) -> None:
    assert keys_in(text) == keys


@pytest.mark.parametrize(
    ("key", "setpoint"),
    [
        ("w", Setpoint(2.0)),
        ("s", Setpoint(-2.0)),
        ("a", Setpoint(0.0, 2.0)),
        ("d", Setpoint(0.0, -2.0)),
        ("r", Setpoint(0.0, 0.0, 0.5)),
        ("f", Setpoint(0.0, 0.0, -0.5)),
        ("q", Setpoint(0.0, 0.0, 0.0, 0.4)),
        ("e", Setpoint(0.0, 0.0, 0.0, -0.4)),
        ("j", Setpoint(0.0)),
    ],
)
def test_each_key_commands_its_axis(key: str, setpoint: Setpoint) -> None:
    keyboard = Keyboard(RATES)
    keyboard.on_text(key, 10.0)
    assert keyboard.setpoint(10.1) == setpoint


def test_key_acts_until_terminal_would_have_repeated_it() -> None:
    keyboard = Keyboard(RATES)
    keyboard.on_text("w", 10.0)
    assert keyboard.setpoint(10.0 + FIRST_S) == Setpoint(2.0)
    assert keyboard.setpoint(10.01 + FIRST_S) == Setpoint(0.0)


def test_released_key_acts_for_quarter_of_second() -> None:
    keyboard = Keyboard(RATES)
    for number in range(20):
        keyboard.on_text("w", 10.0 + 0.03 * number)
    last_s = 10.0 + 0.03 * 19
    assert keyboard.setpoint(last_s + REPEAT_S) == Setpoint(2.0)
    assert keyboard.setpoint(last_s + REPEAT_S + 0.01) == Setpoint(0.0)


@pytest.mark.parametrize("text", [" ", "\x1b[O"])
def test_space_and_lost_focus_stop_vehicle_at_once(text: str) -> None:
    keyboard = Keyboard(RATES)
    keyboard.on_text("wr", 10.0)
    keyboard.on_text(text, 10.05)
    assert keyboard.setpoint(10.1) == Setpoint(0.0)
    assert not keyboard.ended


@pytest.mark.parametrize("text", ["x", "X", "\x03", "\x04"])
def test_keys_that_release_the_vehicle(text: str) -> None:
    keyboard = Keyboard(RATES)
    keyboard.on_text(text, 10.0)
    assert keyboard.ended


def test_newest_key_of_axis_counts_and_axes_combine() -> None:
    keyboard = Keyboard(RATES)
    keyboard.on_text("wsr", 10.0)
    assert keyboard.setpoint(10.1) == Setpoint(-2.0, 0.0, 0.5)


def test_a_vehicle_that_cannot_move_sideways_turns() -> None:
    keyboard = Keyboard(RATES, sideways=False)
    keyboard.on_text("wdr", 10.0)
    assert keyboard.setpoint(10.1) == Setpoint(2.0, 0.0, 0.0, -0.4)


# -- stick


class Board:
    """The mirror of `control/state`."""

    def __init__(self) -> None:
        self.value: ControlState | None = None


class StickModule(FakeClient):
    """A module whose vehicle answers as a test says."""

    def __init__(self) -> None:
        super().__init__()
        self.board = Board()
        self.now = 0
        self.asked: list[tuple[str, DriveRequest]] = []
        self.reply: ControlState | Exception = MINE
        self.answering = asyncio.Event()
        self.answering.set()

    def reader(self, path: str, cls: type[msgspec.Struct], **options: Any) -> Any:
        return self.board

    def now_ns(self) -> int:
        return self.now

    async def request(self, path: str, value: Any, reply: Any, **options: Any) -> Any:
        self.asked.append((path, value))
        if isinstance(self.reply, Exception):
            raise self.reply
        return self.reply

    async def send(self, path: str, value: msgspec.Struct, **options: Any) -> Outcome:
        outcome = await super().send(path, value)
        await self.answering.wait()
        return self.outcome if outcome else outcome


def stick_session() -> tuple[Session, StickModule]:
    module = StickModule()
    return ScriptedSession({}, module), module


async def test_the_stick_is_asked_for_used_and_released() -> None:
    session, module = stick_session()
    stick = await Stick.request(session, "uav1", take=True)
    assert module.asked == [("/uav1/sys/vehicle/drive", DriveRequest(DriveEvent.DRIVE, True))]
    module.now = 400_000_000
    stick.send(Setpoint(1.0))
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert module.sent == [("/uav1/cmd/manual", Setpoint(1.0))]
    assert (stick.sent, stick.delivered, stick.silent_s) == (1, 1, 0.0)
    module.reply = ControlState(DriveMode.AUTO)
    assert (await stick.release()).mode is DriveMode.AUTO
    assert module.asked[-1][1].event is DriveEvent.RELEASE


async def test_refused_stick_has_name_of_its_holder() -> None:
    session, module = stick_session()
    module.reply = Denied("drive: anna@gcs has the stick; --take takes the stick")
    with pytest.raises(Denied, match="anna@gcs has the stick"):
        await Stick.request(session, "uav1", take=False)
    module.reply = NoAnswer("nothing within 2 s")
    with pytest.raises(NoAnswer, match="uav1 does not answer"):
        await Stick.request(session, "uav1", take=False)


async def test_slow_link_does_not_queue_old_set_points() -> None:
    session, module = stick_session()
    stick = await Stick.request(session, "uav1", take=False)
    module.answering.clear()
    for _ in range(10):
        stick.send(Setpoint(1.0))
        await asyncio.sleep(0)
    assert len(module.sent) == stick.sent == UNDER_WAY
    module.now = 2_000_000_000
    assert stick.silent_s == 2.0
    await stick.release()


@pytest.mark.parametrize(
    ("state", "reason"),
    [
        (None, ""),
        (ControlState(DriveMode.AUTO, "", 0, 999, "release"), ""),  # of before
        (ControlState(DriveMode.HOLD, "operator@gcs", 7, 2000, "expired"), ""),
        (ControlState(DriveMode.MANUAL, "bert@gcs", 8, 2000, "drive"), "bert@gcs has taken the stick"),
        (ControlState(DriveMode.PILOT, "", 0, 2000, "switch_manual"), "the safety pilot drives now"),
        (ControlState(DriveMode.AUTO, "", 0, 2000, "order"), "mode auto by order"),
    ],
)
async def test_an_operator_who_lost_the_stick_learns_why(state: ControlState | None, reason: str) -> None:
    session, module = stick_session()
    stick = await Stick.request(session, "uav1", take=False)
    module.board.value = state
    assert stick.lost == reason
    asked = len(module.asked)
    await stick.release()
    assert len(module.asked) == asked + (not reason)  # another one's vehicle is not released


async def test_driving_without_terminal_is_refused_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def known(session: Session) -> dict[str, PlatformKind]:
        return {"uav1": PlatformKind.UAV, "gcs": PlatformKind.GCS}

    monkeypatch.setattr("swarmctl.commands.drive.stick.kinds", known)
    monkeypatch.setattr("swarmctl.commands.drive.stick.VehicleObserver", lambda *_: None)
    session, module = stick_session()
    with pytest.raises(click.UsageError, match="expected a terminal as stdin"):
        await drive_by_hand(session, "uav1", RATES, take=False)
    with pytest.raises(InvalidInput, match="a ground station; expected a vehicle"):
        await drive_by_hand(session, "gcs", RATES, take=False)
    assert module.asked == []


def test_line_has_mode_age_and_what_vehicle_does() -> None:
    text = line("uav1", MINE, 0.12, "flying 3.1 m armed", Setpoint(1.0))
    assert text.startswith("uav1 manual · answered 0.1 s ago · flying 3.1 m armed · forward +1.0")
    assert "NO ANSWER for 2.0 s: it holds" in line("uav1", MINE, 2.0, "", Setpoint(0.0))


# -- takeoff and goto


@pytest.mark.parametrize(
    ("seen", "up", "there"),
    [
        (sight(vehicle=UP, pose=Pose.planar(3.0, 4.0, 5.2)), True, True),
        (sight(vehicle=UP, pose=Pose.planar(3.0, 4.0, 3.0)), False, False),
        (sight(vehicle=UP, pose=Pose.planar(9.0, 4.0, 5.0)), True, False),
        (sight(vehicle=UP, pose=Pose.planar(3.0, 4.0, 5.0, velocity_m_s=(2.0, 0.0, 0.0))), False, False),
        (sight(vehicle=DOWN, pose=Pose.planar(3.0, 4.0, 5.0)), False, True),
        (sight(vehicle=None, pose=None), False, False),
    ],
)
def test_takeoff_and_goto_end_when_vehicle_arrives(seen: VehicleSnapshot, up: bool, there: bool) -> None:
    assert risen_to(5.0)(seen) is up
    assert arrived_at(3.0, 4.0, 5.0)(seen) is there
    assert arrived_at(3.0, 4.0, None)(sight(vehicle=UP, pose=Pose.planar(3.0, 4.0, 50.0)))


@pytest.mark.parametrize("text", ["", "1", "a,b", "1,2,3,4", "nan,1", "1,inf"])
def test_a_place_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter, match="expected X,Y or X,Y,Z in metres"):
        Place().convert(text, None, None)
    assert Place().convert("1,-2.5,3", None, None) == (1.0, -2.5, 3.0)


@pytest.mark.parametrize("options", [[], ["--to", "1,2", "--by", "1,2"]])
def test_goto_needs_a_place_or_a_displacement(options: list[str]) -> None:
    done = CliRunner().invoke(cli, ["goto", "uav1", *options])
    assert (done.exit_code, "expected --to X,Y[,Z] or --by X,Y[,Z]" in done.output) == (2, True)


class Asked:
    """The requests to each vehicle, and when it counts as done."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **chosen: str) -> None:
        self.orders: dict[str, ManoeuvreRequest] = {}
        self.done: Any = {}

        async def choose(session: Session, wanted: tuple[str, ...]) -> dict[str, PlatformKind]:
            return {name: PlatformKind(kind) for name, kind in chosen.items()}

        async def request(session: Session, orders: Any, chosen: Any, done: Any, wait_s: float) -> None:
            self.orders, self.done = dict(orders), done

        async def poses(session: Session, chosen: Any) -> dict[str, Pose]:
            return dict.fromkeys(chosen, Pose.planar(10.0, 20.0, 5.0))

        monkeypatch.setattr(requests, "choose", choose)
        monkeypatch.setattr(requests, "request", request)
        monkeypatch.setattr(requests, "_poses", poses)


async def test_only_several_takeoffs_ask_for_confirmation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    session = ScriptedSession({})
    asked = Asked(monkeypatch, uav1="uav")
    await requests.take_off(session, ("uav1",), 4.0, 1.0, "test", 60.0, yes=False)
    params = {"altitude_m": 4.0, "speed_m_s": 1.0}
    assert asked.orders == {"uav1": ManoeuvreRequest("takeoff", params, "test")}

    asked = Asked(monkeypatch, uav1="uav", uav2="uav", ugv1="ugv")
    with pytest.raises(click.UsageError, match="take off uav1, uav2: motors turn: expected --yes"):
        await requests.take_off(session, (), 4.0, 1.0, "test", 60.0, yes=False)
    await requests.take_off(session, (), 4.0, 1.0, "test", 60.0, yes=True)
    assert list(asked.orders) == ["uav1", "uav2"]

    Asked(monkeypatch, ugv1="ugv")
    with pytest.raises(InvalidInput, match="ugv1: does not fly; expected a vehicle of kind uav"):
        await requests.take_off(session, ("ugv1",), 4.0, 1.0, "test", 60.0, yes=True)


async def test_goto_displaces_each_vehicle_or_places_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    session = ScriptedSession({})
    asked = Asked(monkeypatch, uav1="uav", ugv1="ugv")
    await requests.go_to(session, (), None, (1.0, -2.0, 3.0), 1.5, "test", 60.0)
    assert asked.orders["uav1"].params == {"x_m": 11.0, "y_m": 18.0, "z_m": 8.0, "speed_m_s": 1.5}
    assert asked.orders["ugv1"].params == {"x_m": 11.0, "y_m": 18.0, "speed_m_s": 1.5}
    with pytest.raises(click.UsageError, match="uav1, ugv1 would meet at one place; expected one, or --by"):
        await requests.go_to(session, (), (1.0, 2.0), None, 1.5, "test", 60.0)
    asked = Asked(monkeypatch, uav1="uav")
    await requests.go_to(session, ("uav1",), (1.0, 2.0), None, 1.5, "test", 60.0)
    assert asked.orders["uav1"].params == {"x_m": 1.0, "y_m": 2.0, "speed_m_s": 1.5}


async def test_refused_manoeuvre_is_raised_or_listed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def follow(session: Session, what: str, chosen: Any, done: Any, send: Any, wait_s: float) -> Any:
        return [
            SimpleNamespace(platform=name, ok=not text, text=text)
            for name in chosen
            for text in [await send(name)]
        ]

    monkeypatch.setattr(manoeuvre, "follow", follow)
    session, module = stick_session()

    async def reach(platform: str) -> None:
        if platform == "uav1":
            raise NoAnswer("no route")

    session.reach = reach  # type: ignore[method-assign]
    kinds = {"uav1": PlatformKind.UAV, "uav2": PlatformKind.UAV}
    orders = dict.fromkeys(kinds, ManoeuvreRequest("goto", {}))
    with pytest.raises(Partial, match=r"goto: uav1 \(no route\)"):
        await manoeuvre.request(session, orders, kinds, {}, 1.0)
    assert [path for path, _ in module.asked] == ["/uav2/sys/mission/manoeuvre"]
    with pytest.raises(NoAnswer, match="no route"):
        await manoeuvre.request(session, {"uav1": orders["uav1"]}, {"uav1": PlatformKind.UAV}, {}, 1.0)
