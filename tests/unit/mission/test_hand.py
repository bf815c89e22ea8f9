"""A vehicle that is driven by hand: its mission is held, ended by orders and by a lost link."""

from typing import Any

import msgspec
import pytest
from tests.unit.mission.nets import net
from tests.unit.mission.results import result
from tests.unit.mission.steps import ARM, HOLD, A, Member1, S, words

from swarmd.mission.blocks.motions import ForcedArm
from swarmd.mission.builtin import MANOEUVRES, manoeuvre
from swarmd.mission.core.nav_fault import NavFaultTimeouts
from swarmd.mission.core.run import Action, Announce, ProgressStep, Run, TakeVehicle
from swarmware.errors import Conflict, InvalidInput, MissionError
from swarmware.mission.binding import Binding
from swarmware.mission.loader import load
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.control import ControlState, DriveMode
from swarmware.types.mission import MissionPhase, MissionState
from swarmware.types.navigation import NavError, NavState, NavStatus

MANUAL = ControlState(DriveMode.MANUAL, "anna@gcs", 7)
HELD = ControlState(DriveMode.HOLD, "anna@gcs", 7)
AUTO = ControlState(DriveMode.AUTO)
PILOT = ControlState(DriveMode.PILOT)


def taken(actions: list[Action]) -> list[bool]:
    return [action.ordered for action in actions if isinstance(action, TakeVehicle)]


def texts(actions: list[Action]) -> list[tuple[str, str]]:
    return [(a.event, a.text) for a in actions if isinstance(a, ProgressStep)]


def announced(actions: list[Action]) -> list[str]:
    return [action.state.held_by for action in actions if isinstance(action, Announce)]


def with_key(**top: Any) -> str:
    return msgspec.json.encode(msgspec.json.decode(ARM) | top).decode()


def test_mission_is_held_during_driving_by_hand() -> None:
    m = Member1()
    m.order()
    actions = m.core.on_control(MANUAL, S)
    assert texts(actions) == [("held", "driven by anna@gcs")]
    assert announced(actions) == ["anna@gcs"]
    assert (m.phase, m.core.state().held_by) == ("running", "anna@gcs")
    assert texts(m.core.on_control(HELD, 2 * S)) == []  # still held by the same operator
    assert texts(m.core.on_control(AUTO, 3 * S)) == [("resumed", "")]
    assert words(m.core.on_ended(1, result("ok"), "", 4 * S)) == ["state:ending", "state:done"]


def test_the_safety_pilot_holds_the_mission_too() -> None:
    m = Member1()
    m.order()
    m.core.on_control(PILOT, S)
    assert m.core.state().held_by == "pilot"


def test_mission_cannot_begin_at_hand_driven_vehicle() -> None:
    m = Member1()
    m.core.on_control(MANUAL, 0)
    with pytest.raises(Conflict, match="a is driven by hand by anna@gcs"):
        m.order()
    m.core.on_control(AUTO, S)
    assert "state:running" in m.order()


def test_order_takes_vehicle_from_operator_who_drives() -> None:
    m = Member1()
    m.core.on_control(MANUAL, 0)
    assert taken(m.core.on_abort("test", "land", S)) == [True]
    assert m.phase == "recovering"


def test_same_order_again_asks_for_vehicle_again() -> None:
    m = Member1()
    m.core.on_abort("test", "land", S)
    m.core.on_control(MANUAL, 2 * S)
    assert taken(m.core.on_abort("test", "land", 3 * S)) == [True]


def test_order_at_undriven_vehicle_needs_no_confirmation() -> None:
    m = Member1()
    assert taken(m.core.on_abort("test", "land", S)) == []


def test_failed_mission_takes_only_undriven_vehicle() -> None:
    m = Member1()
    m.order()
    m.core.on_control(MANUAL, S)
    assert taken(m.core.on_ended(1, result("error:refused"), "", 2 * S)) == [False]
    assert m.phase == "recovering"
    # the request was refused while the operator drove; it is repeated when the set-points stop
    assert taken(m.core.on_control(HELD, 3 * S)) == [False]


def test_manoeuvre_is_played_and_newer_one_replaces_it() -> None:
    m = Member1()
    first = manoeuvre("goto", {"x_m": 1.0, "y_m": 2.0}, "a", PlatformKind.UAV)
    second = manoeuvre("goto", {"x_m": 5.0, "y_m": 2.0}, "a", PlatformKind.UAV)
    assert "start goto 1" in words(m.core.on_manoeuvre("goto", first, "test", S))
    assert (m.phase, m.core.state().mission) == ("recovering", "goto")
    assert "cancel 1" in words(m.core.on_manoeuvre("goto", second, "test", 2 * S))
    assert "start goto 2" in words(m.core.on_ended(1, result("cancelled"), "", 3 * S))
    m.core.on_ended(2, result("ok"), "", 4 * S)
    assert m.phase == "done"


def test_a_manoeuvre_ends_the_running_mission() -> None:
    m = Member1()
    m.order()
    up = manoeuvre("takeoff", {"altitude_m": 4.0}, "a", PlatformKind.UAV)
    m.core.on_manoeuvre("takeoff", up, "test", S)
    assert "start arm 2" in words(m.core.on_ended(1, result("cancelled"), "", 2 * S))
    m.core.on_ended(2, result("ok"), "", 3 * S)
    m.core.on_ended(3, result("ok"), "", 4 * S)
    assert m.phase == "aborted"


def test_manoeuvre_of_past_is_no_built_in_mission() -> None:
    m = Member1()
    up = manoeuvre("takeoff", {"altitude_m": 4.0}, "a", PlatformKind.UAV)
    m.core.on_manoeuvre("takeoff", up, "test", S)
    with pytest.raises(Conflict, match="'takeoff': unknown; expected land, hold"):
        m.core.on_abort("test", "takeoff", 2 * S)


@pytest.mark.parametrize(
    ("name", "params", "kind", "text"),
    [
        ("dance", {}, "uav", "unknown; expected one of takeoff, goto"),
        ("takeoff", {}, "uav", "expected altitude_m, speed_m_s"),
        ("takeoff", {"altitude_m": 3.0}, "ugv", "does not fly"),
        ("goto", {"x_m": 3.0}, "uav", "parameters x_m; expected x_m, y_m"),
        ("goto", {"x_m": 3.0, "y_m": 1.0, "yaw_rad": 1.0}, "uav", "expected x_m, y_m"),
        ("goto", {"x_m": 90_000.0, "y_m": 1.0}, "ugv", "a: 'goto': 90000 m from the map's origin"),
        ("goto", {"x_m": 3.0, "y_m": 1.0, "z_m": -30.0}, "uav", "30 m below the map's origin"),
        ("goto", {"x_m": 3.0, "y_m": 1.0, "z_m": -2.0}, "uav", "at a height of -2 m"),
        ("takeoff", {"altitude_m": 900.0}, "uav", "a height of 900 m"),
    ],
)
def test_a_manoeuvre_with_other_parameters_is_refused(
    name: str, params: dict[str, float], kind: str, text: str
) -> None:
    with pytest.raises(InvalidInput, match=text):
        manoeuvre(name, params, "a", PlatformKind(kind))


def test_manoeuvre_out_of_range_is_refused() -> None:
    with pytest.raises(MissionError, match="altitude_m"):
        manoeuvre("takeoff", {"altitude_m": -3.0}, "a", PlatformKind.UAV)


def test_only_an_operator_forces_a_take_off() -> None:
    forced = manoeuvre("takeoff", {"altitude_m": 4.0}, "a", PlatformKind.UAV, force="anna: test")
    assert forced.blocks["arm"].params == ForcedArm(reason="anna: test")
    assert not isinstance(
        manoeuvre("takeoff", {"altitude_m": 4.0}, "a", PlatformKind.UAV).blocks["arm"].params, ForcedArm
    )
    for key in ("force", "reason"):
        arm = {"type": "Arm", "next": "e", key: "anna"}
        blocks = {"s": {"type": "Start", "next": "arm"}, "arm": arm, "e": {"type": "End"}}
        with pytest.raises(MissionError, match=key):
            load(msgspec.json.encode({"mission": blocks}).decode(), "m.json", Binding("a", PlatformKind.UAV))


def test_every_manoeuvre_loads_with_all_its_parameters() -> None:
    for name, (needed, others) in MANOEUVRES.items():
        manoeuvre(name, dict.fromkeys(needed | others, 2.0), "a", PlatformKind.UAV)


def test_a_reaction_takes_a_vehicle_that_holds() -> None:
    m = Member1()
    m.core.on_control(HELD, 0)
    assert taken(m.core.on_reaction("gone", "land", S)) == [False]
    assert (m.phase, m.core.state().mission) == ("recovering", "land")


def test_operators_manoeuvre_ignores_silent_set_points() -> None:
    m = Member1()
    m.core.on_abort("test", "land", 0)
    m.core.on_control(MANUAL, S)
    assert taken(m.core.on_control(HELD, 2 * S)) == []
    # but a reaction lets it continue
    assert taken(m.core.on_reaction("gone", "land", 4 * S)) == [False]


def test_a_goto_is_replaced_by_a_reaction() -> None:
    m = Member1()
    away = manoeuvre("goto", {"x_m": 1.0, "y_m": 2.0}, "a", PlatformKind.UAV)
    m.core.on_manoeuvre("goto", away, "test", 0)
    m.core.on_reaction("gone", "land", S)
    m.core.on_ended(1, result("cancelled"), "", S)
    assert m.core.state().mission == "land"


def test_landing_is_not_replaced_by_weaker_reaction() -> None:
    m = Member1()
    m.core.on_abort("test", "land", 0)
    assert taken(m.core.on_reaction("gone", "hold", S)) == []
    assert m.core.state().mission == "land"


def test_unknown_policy_is_refused_with_place() -> None:
    with pytest.raises(MissionError, match=r"/on_link_loss.*expected one of continue, land, hold, return"):
        load(with_key(on_link_loss="dance"), "m.json", Binding())
    assert load(with_key(on_link_loss="hold"), "m.json", Binding()).on_link_loss == "hold"


def test_navigator_reports_during_driving_do_not_count() -> None:
    timeouts = NavFaultTimeouts({NavError.NONE: 10.0, NavError.NO_WAY: 10.0})
    blocked = NavStatus(1, NavState.BLOCKED, error=NavError.NO_WAY)
    assert timeouts.lost(blocked, 0) is None
    timeouts.reset()
    assert timeouts.lost(blocked, 11 * S) is None
    assert timeouts.lost(blocked, 22 * S) is not None


def test_beacon_names_driver_only_during_driving() -> None:
    state = MissionState(1, "00000001", MissionPhase.RUNNING)
    held = msgspec.structs.replace(state, held_by="anna@gcs")
    assert MissionState.unpack(held.pack()) == held
    assert MissionState.unpack(state.pack()) == state
    assert len(held.pack()) == len(state.pack()) + len("anna@gcs") + 2


def test_run_of_mission_has_policy_of_its_role() -> None:
    mission = load(net(s="Start>e", e="End"), "m.json", Binding())
    assert Run(mission, "hop", "00", 1, "x", (A,)).mission.on_link_loss == ""
    assert HOLD.on_link_loss == ""
