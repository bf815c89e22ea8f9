"""Reactions: when a row acts, which action precedes which, and what an order of an operator changes."""

from typing import Any

import msgspec
import pytest
from tests.unit.mission.results import result
from tests.unit.mission.steps import ARM, Member1, S, words

from swarmd.mission.config import REACTIONS, Config
from swarmd.mission.core.reactions import React, ReactionTable, RowChanged, Situation, link_loss_row
from swarmware.errors import Conflict, InvalidInput
from swarmware.mission.field_path import Scalar, scalar_of
from swarmware.mission.reaction import ReactionRow, decode_rows, encode_rows
from swarmware.types.health import HealthState
from swarmware.types.reaction import ReactionPhase

AIR = Situation(armed=True, airborne=True)
GROUND = Situation(armed=True, airborne=False)
RESTS = Situation(armed=False, airborne=False)


class World:
    """Values of resources, and a table that looks at them once a second."""

    def __init__(self, *rows: ReactionRow) -> None:
        self.values: dict[str, Scalar] = {}
        self.ages: dict[str, float] = {}
        self.table = ReactionTable()
        self.table.set_rows(rows, {})
        self.now_ns = 0

    def value(self, path: str, field: str) -> Scalar | None:
        return self.values.get(f"{path}.{field}")

    def age_s(self, path: str) -> float | None:
        return self.ages.get(path)

    def look(self, situation: Situation = AIR, after_s: float = 1.0) -> list[tuple[str, str]]:
        """Row and action of each reaction."""
        self.now_ns += round(after_s * 1e9)
        found = self.table.on_look(self, situation, self.now_ns)
        self.changed = [
            (one.state.row, one.state.phase.value) for one in found if isinstance(one, RowChanged)
        ]
        self.reasons = [one.reason for one in found if isinstance(one, React)]
        return [(one.row.name, one.action) for one in found if isinstance(one, React)]

    def phases(self) -> dict[str, str]:
        return {one.row: one.phase.value for one in self.table.states()}


def row(name: str = "hot", **keys: Any) -> ReactionRow:
    plain = {"name": name, "when": "my/oven.hot", "action": "land"} | keys
    return msgspec.convert(plain, ReactionRow)


def hot(*rows: ReactionRow) -> World:
    world = World(*rows)
    world.values["my/oven.hot"] = True
    return world


def test_row_acts_once_after_hold_time() -> None:
    world = hot(row(for_s=2.5))
    assert world.look() == []
    assert world.phases() == {"hot": "pending"}
    assert [world.look(), world.look()] == [[], []]
    assert world.look() == [("hot", "land")]
    assert world.reasons == ["my/oven.hot for 3 s"]
    assert world.changed == [("hot", "active")]
    assert world.look() == []
    world.values["my/oven.hot"] = False
    assert world.look() == []
    assert (world.changed, world.phases()) == ([("hot", "idle")], {"hot": "idle"})
    world.values["my/oven.hot"] = True
    assert [world.look() for _ in range(4)] == [[], [], [], [("hot", "land")]]


def test_break_of_condition_begins_hold_time_again() -> None:
    world = hot(row(for_s=2.0))
    for holds in (True, True, False, True, True):
        world.values["my/oven.hot"] = holds
        assert world.look() == []
    assert world.look() == [("hot", "land")]


def test_unknown_value_never_causes_reaction_and_ends_one() -> None:
    world = World(row(), row("cold", when="not my/oven.hot"))
    assert world.look() == []
    assert world.phases() == {"hot": "idle", "cold": "idle"}
    world.values["my/oven.hot"] = True
    assert world.look() == [("hot", "land")]
    del world.values["my/oven.hot"]
    world.look()
    assert world.phases() == {"hot": "idle", "cold": "idle"}


@pytest.mark.parametrize(
    ("where", "acts"),
    [("air", (True, False, False)), ("ground", (False, True, False)), ("any", (True, True, False))],
)
def test_row_applies_to_stated_armed_vehicles_only(where: str, acts: tuple[bool, ...]) -> None:
    for situation, expected in zip((AIR, GROUND, RESTS), acts, strict=True):
        assert hot(row(where=where)).look(situation) == ([("hot", "land")] if expected else [])


def test_inapplicable_row_becomes_idle() -> None:
    world = hot(row())
    world.look()
    world.look(GROUND)
    assert world.phases() == {"hot": "idle"}


def test_the_strongest_of_several_actions_comes_first() -> None:
    names = ("warn", "return", "emergency-land", "hold", "land")
    world = hot(*(row(name.replace("-", "_"), action=name) for name in names))
    assert [action for _, action in world.look()] == ["emergency-land", "land", "return", "hold"]
    assert len(world.changed) == len(names)


def test_alternative_action_replaces_impossible_first() -> None:
    keys = {"action": "return", "possible": "my/way.left > 0.2", "otherwise": "land"}
    for left, expected in ((0.3, "return"), (0.1, "land"), (None, "land")):
        world = hot(row(**keys))
        if left is not None:
            world.values["my/way.left"] = left
        assert world.look() == [("hot", expected)]
    assert world.reasons == ["my/oven.hot; return is not possible: not my/way.left > 0.2"]


def test_action_becoming_impossible_is_replaced_once() -> None:
    world = hot(row(action="return", possible="my/way.left > 0.2", otherwise="land"))
    world.values["my/way.left"] = 0.3
    assert world.look() == [("hot", "return")]
    world.values["my/way.left"] = 0.1
    assert world.look() == [("hot", "land")]
    assert world.reasons == ["my/oven.hot; return is no longer possible"]
    world.values["my/way.left"] = 0.3
    assert world.look() == []
    assert world.table.states()[0].action == "land"


def test_order_after_reaction_stands_unless_row_is_lasting() -> None:
    once, lasting = hot(row(action="return", possible="my/way.ok", otherwise="land")), hot(row(lasting=True))
    once.values["my/way.ok"] = True
    for world in (once, lasting):
        assert len(world.look()) == 1
    later = msgspec.structs.replace(AIR, orders=1)
    once.values["my/way.ok"] = False
    assert once.look(later) == []
    once.table.check_order("goto")
    assert [lasting.look(later), lasting.look(later)] == [[("hot", "land")], []]


@pytest.mark.parametrize(
    ("order", "refused"),
    [("goto", True), ("survey", True), ("hold", True), ("return", True), ("land", False)],
)
def test_lasting_reaction_refuses_weaker_orders_with_its_reason(order: str, refused: bool) -> None:
    world = hot(row(lasting=True, says="too hot"))
    world.table.check_order(order)
    world.look()
    if refused:
        with pytest.raises(
            Conflict, match=r"hot is active \(land: too hot\); expected land or emergency-land"
        ):
            world.table.check_order(order)
    else:
        world.table.check_order(order)


def test_mission_row_precedes_platform_row_by_name() -> None:
    platform, mission = row(), row(action="hold")
    world = hot()
    world.table.set_rows([mission, platform], {})
    assert world.look() == [("hot", "hold")]
    # the mission has ended by its own reaction, which stays what it is until the cause is gone
    world.table.set_rows([platform], {})
    assert world.look() == []
    assert world.table.states()[0].action == "hold"
    world.values["my/oven.hot"] = False
    world.look()
    world.table.set_rows([platform], {})
    world.values["my/oven.hot"] = True
    assert world.look() == [("hot", "land")]


def test_mission_only_row_is_dropped_when_idle() -> None:
    world = hot()
    world.table.set_rows([row("own")], {})
    world.look()
    world.table.set_rows([], {})
    assert world.phases() == {"own": "active"}
    world.look(RESTS)
    world.table.set_rows([], {})
    assert world.phases() == {}


def test_hold_time_of_changed_row_continues() -> None:
    world = hot(row(for_s=30.0))
    world.look()
    for _ in range(4):
        assert world.look() == []
    world.table.set_rows([row(for_s=3.0, action="hold")], {})
    assert world.look() == [("hot", "hold")]


def test_time_without_node_is_no_hold_time() -> None:
    world = hot(row(for_s=5.0))
    world.look()
    assert world.look(after_s=60.0) == []
    assert [world.look() for _ in range(4)] == [[], [], [], [("hot", "land")]]


@pytest.mark.parametrize(
    ("policy", "expected"),
    [("continue", []), ("hold", [("link_loss", "hold")]), ("land", [("link_loss", "land")])],
)
def test_lost_link_is_row_with_policy(policy: str, expected: list[Any]) -> None:
    world = World(link_loss_row(policy, 30.0))
    world.values |= {"mission/state.state": "running", "mission/state.mission": "return"}
    for _ in range(99):
        assert world.look() == [], "no ground station was ever in reach"
    world.values["mission/watch.station"] = False
    for _ in range(30):
        assert world.look() == []
    assert world.look() == expected
    assert world.changed == [("link_loss", "active")]
    assert world.table.states()[0].reason == "no ground station in reach for 30 s"
    world.values["mission/watch.station"] = True
    world.look()
    assert world.phases() == {"link_loss": "idle"}


def test_a_return_goes_on_without_a_link() -> None:
    world = World(link_loss_row("land", 30.0))
    world.values |= {
        "mission/watch.station": False,
        "mission/state.state": "recovering",
        "mission/state.mission": "return",
    }
    for _ in range(60):
        assert world.look() == []


def shipped(battery: str = "ok", age_s: float = 0.1, **values: Scalar) -> World:
    world = World(*REACTIONS)
    world.values |= {"health/state.battery": battery, "mission/watch.restarted": False}
    world.values |= {name.replace("__", "/way_home."): value for name, value in values.items()}
    world.ages["nav/pose"] = age_s
    return world


@pytest.mark.parametrize(
    ("world", "expected"),
    [
        (shipped(), []),
        (shipped("unknown"), []),
        (shipped("low"), [("battery_low", "land")]),
        (
            shipped("low", vehicle__needed_ratio=0.2, vehicle__remaining_ratio=0.3),
            [("battery_low", "return")],
        ),
        (shipped("low", vehicle__needed_ratio=0.4, vehicle__remaining_ratio=0.3), [("battery_low", "land")]),
        (
            shipped("critical", vehicle__needed_ratio=0.1, vehicle__remaining_ratio=0.14),
            [("battery_critical", "land"), ("battery_low", "return")],
        ),
    ],
)
def test_the_shipped_rows_watch_the_battery(world: World, expected: list[tuple[str, str]]) -> None:
    assert world.look() == expected
    assert world.look(GROUND) == []


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ("loop=away", [("loop_late", "land")]),
        ("loop=starved", [("loop_late", "land")]),
        ("loop=late", []),
        ("tilt=beyond", [("tilted", "land")]),
        ("contact=touched", [("ground_touched", "land")]),
    ],
)
def test_shipped_rows_land_after_faults_of_flight(fault: str, expected: list[tuple[str, str]]) -> None:
    world = shipped()
    state = HealthState("error", "ok", faults=("guard/x=died", f"hal/flight/{fault}"))
    world.value = lambda path, field: (  # type: ignore[method-assign]
        scalar_of(state, field) if path == "health/state" else world.values.get(f"{path}.{field}")
    )
    assert world.look() == expected
    assert world.look(GROUND, 0.0) == []


def test_shipped_rows_land_without_position_after_restart() -> None:
    world = shipped(age_s=2.0)
    assert [world.look() for _ in range(9)] == [[]] * 9
    assert world.look() == [("position_lost", "land")]
    restarted = shipped()
    restarted.values["mission/watch.restarted"] = True
    for situation in (AIR, GROUND):
        assert shipped().look(situation) == []
        assert restarted.look(situation) == [("mission_restarted", "land")]
        restarted = shipped()
        restarted.values["mission/watch.restarted"] = True


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        ({"when": "battery <"}, "reaction hot, key when: condition 'battery <' at its end"),
        ({"when": ""}, "key when: condition ''"),
        ({"possible": "3", "otherwise": "emergency-land"}, "key possible: condition '3' at its end"),
        ({"possible": "battery > 3 %"}, "`possible` and `otherwise` belong together"),
        ({"otherwise": "land"}, "`possible` and `otherwise` belong together"),
        (
            {"possible": "battery > 3 %", "otherwise": "hold"},
            "otherwise = 'hold' is not stronger than 'land'; expected one of emergency-land",
        ),
        ({"action": "fly"}, "Invalid enum value 'fly'"),
        ({"name": "Hot"}, "matching regex"),
        ({"for_s": -1.0}, "`float` >= 0.0"),
    ],
)
def test_senseless_row_is_refused_with_place(keys: dict[str, Any], text: str) -> None:
    with pytest.raises(msgspec.ValidationError) as caught:
        row(**keys)
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("names", "text"),
    [(("a", "a"), "'a' is a row already; expected unique names"), (("link_loss",), "is set by the keys")],
)
def test_row_names_are_unique_and_setting_exists(names: tuple[str, ...], text: str) -> None:
    rows = tuple(row(name) for name in names)
    with pytest.raises(InvalidInput, match=text):
        Config(reaction=rows)
    with pytest.raises(InvalidInput, match=text):
        decode_rows(encode_rows(rows))


def test_rows_travel_with_an_order() -> None:
    rows = (row(for_s=2.0, possible="battery > 3 %", otherwise="emergency-land"), row("b", action="warn"))
    assert decode_rows(encode_rows(rows)) == rows
    assert (encode_rows(()), decode_rows("")) == ("", ())
    for text in ("[", '[{"name": "a"}]', "{}"):
        with pytest.raises(InvalidInput, match="reactions: "):
            decode_rows(text)


def test_note_says_why_row_can_never_act() -> None:
    world = World()
    world.table.set_rows([row()], {"hot": "no such field"})
    assert world.table.states()[0].note == "no such field"
    assert world.table.resources() == {"my/oven"}


# -- what the executor does with an action


@pytest.mark.parametrize(
    ("first", "second", "played"),
    [
        ("hold", "land", "land"),
        ("land", "hold", "land"),
        ("land", "land", "land"),
        ("hold", "hold", "hold"),
    ],
)
def test_weaker_action_never_replaces_stronger_one_that_runs(first: str, second: str, played: str) -> None:
    m = Member1()
    m.core.on_reaction("one", first, S)
    m.core.on_reaction("two", second, 2 * S)
    if first != played:
        m.core.on_ended(1, result("cancelled"), "", 2 * S)
    assert m.core.state().mission == played


def test_a_reaction_ends_a_running_mission() -> None:
    m = Member1()
    m.order()
    assert words(m.core.on_reaction("battery low", "land", S)) == ["state:ending", "cancel 1"]
    # while the mission ends, a weaker reaction changes nothing, but a stronger one does
    m.core.on_reaction("fence", "hold", S)
    m.core.on_ended(1, result("cancelled"), "", S)
    assert (m.phase, m.core.state().mission) == ("recovering", "land")


def test_stronger_reaction_replaces_pending_weaker() -> None:
    m = Member1()
    m.order()
    m.core.on_reaction("fence", "hold", S)
    m.core.on_reaction("battery low", "land", S)
    m.core.on_ended(1, result("cancelled"), "", S)
    assert m.core.state().mission == "land"


def test_a_ground_station_has_no_actions() -> None:
    m = Member1("gcs")
    assert m.core.on_reaction("battery low", "land", S) == []


def test_orders_are_counted_and_reactions_are_not() -> None:
    m = Member1()
    m.order(ARM)
    m.core.on_reaction("battery low", "land", S)
    assert m.core.orders == 1
    m.core.on_abort("test", "hold", S)
    assert m.core.orders == 2


def test_mission_rows_count_while_it_runs() -> None:
    m = Member1()
    assert (m.core.rows, m.core.on_link_loss) == ((), "")
    m.order(ARM.replace("{", '{"on_link_loss": "hold", ', 1))
    assert m.core.on_link_loss == "hold"
    m.core.on_abort("test", "land", S)
    assert m.core.on_link_loss == ""


def test_every_phase_is_one_that_operators_see() -> None:
    assert [phase.value for phase in ReactionPhase] == ["idle", "pending", "active"]


def test_change_of_row_names_values_that_caused_it() -> None:
    table = ReactionTable()
    table.set_rows([row(when="my/oven.heat > 0.5 and age(my/oven) < 3")], {})
    world = World()
    world.values["my/oven.heat"], world.ages["my/oven"] = 0.75, 1.0
    (changed, _) = table.on_look(world, AIR, S)
    assert isinstance(changed, RowChanged)
    assert changed.values == "my/oven.heat 0.75, age(my/oven) 1.0 s"


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"action": "mission"}, "expected both or none"),
        ({"mission": "survey"}, "expected both or none"),
        ({"action": "land", "resume": True}, "`resume` is possible for hold and return"),
        ({"action": "hold", "resume": True, "lasting": True}, "`resume` is possible for hold and return"),
    ],
)
def test_contradicting_keys_of_row_are_refused(keys: dict[str, Any], words: str) -> None:
    plain = {"name": "hot", "when": "my/oven.hot", "action": "land"} | keys
    with pytest.raises(InvalidInput, match=words):
        ReactionRow(**plain)


def test_interrupted_mission_continues_after_reaction() -> None:
    m = Member1()
    m.order()
    assert words(m.core.on_interruption("wind", "gust", "hold", S)) == ["state:suspending", "cancel 1"]
    assert m.ended(1, "cancelled") == ["state:suspended", "state:recovering", "start hold 2"]
    assert m.core.waits(7) == "reaction wind is active"
    assert m.ended(2) == ["state:ending", "state:done"]
    with pytest.raises(Conflict, match="reaction wind is active"):
        m.order(epoch=8)
    assert m.core.on_reaction_over("another", S) == []
    assert words(m.core.on_reaction_over("wind", S)) == ["state:running", "start a 3"]


def test_landing_ends_interrupted_mission() -> None:
    m = Member1()
    m.order()
    m.core.on_interruption("wind", "gust", "hold", S)
    m.core.on_reaction("battery critical", "land", S)
    assert m.ended(1, "cancelled") == ["state:recovering", "start land 2"]
    m.ended(2)
    assert m.core.is_idle
