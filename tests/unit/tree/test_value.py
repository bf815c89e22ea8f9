"""From what an operator typed to a value of a resource's type."""

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.tree.core.values.value import check_settable, typed, unpacked, with_field
from swarmware.errors import Denied, InvalidInput, NotFound, OutOfRange, SwarmError, TypeMismatch
from swarmware.model.resource import Kind, Resource
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.scalar import Bool, Float, Int, Text
from swarmware.types.vehicle import Pose

SPEED = Resource(
    path="config/speed_m_s",
    kind=Kind.SETTING,
    type="Float",
    unit="m/s",
    range=(0.0, 12.0),
    access="rw",
    default=1,
)
MODE = Resource(
    path="config/mode", kind=Kind.SETTING, type="Text", choices=("auto", "manual"), default="auto"
)
GOAL = Resource(path="nav/goal", type="Goal", access="rw")


def plain(type_name: str) -> Resource:
    return Resource(path="a", type=type_name, access="rw")


@pytest.mark.parametrize(
    ("resource", "given_value", "expected"),
    [
        (SPEED, 3, Float(3.0)),
        (SPEED, 3.5, Float(3.5)),
        (SPEED, [3.5], Float(3.5)),
        (SPEED, {"value": 3.5}, Float(3.5)),
        (plain("Int"), 7, Int(7)),
        (plain("Bool"), True, Bool(True)),
        (plain("Text"), "x", Text("x")),
        (MODE, "manual", Text("manual")),
        (GOAL, {"seq": 1, "kind": GoalKind.GOTO, "x_m": 2}, Goal(1, GoalKind.GOTO, 2.0)),
        (GOAL, [1, GoalKind.GOTO, 2.5], Goal(1, GoalKind.GOTO, 2.5)),
        (
            GOAL,
            {"seq": 1, "kind": "formation", "offset_m": [1.0, 2.0, 0.0]},
            Goal(1, GoalKind.FORMATION, offset_m=(1, 2, 0)),
        ),
        (plain("Pose"), {"x_m": 1, "y_m": 2}, Pose(1.0, 2.0)),
    ],
)
def test_plain_data_become_a_value(resource: Resource, given_value: object, expected: msgspec.Struct) -> None:
    assert typed(resource, given_value, "p") == expected


@pytest.mark.parametrize(
    ("resource", "given_value", "error", "said"),
    [
        (SPEED, "fast", TypeMismatch, "p: expected `float`, got `str`"),
        (SPEED, True, TypeMismatch, "p: expected `float`, got `bool`"),
        (SPEED, None, TypeMismatch, "got `null`"),
        (SPEED, 12.5, OutOfRange, "p: 12.5 m/s; expected 0 to 12 m/s"),
        (SPEED, math.nan, OutOfRange, "p: nan m/s; expected 0 to 12 m/s"),
        (plain("Int"), 7.5, TypeMismatch, "expected `int`, got `float`"),
        (MODE, "off", OutOfRange, "p: 'off'; expected one of auto, manual"),
        (
            GOAL,
            {"seq": 1, "kind": "goto", "zz": 2},
            TypeMismatch,
            "no field 'zz' in Goal; expected some of seq",
        ),
        (GOAL, {"seq": 1}, TypeMismatch, "field 'kind' of Goal is missing"),
        (GOAL, {"seq": 1, "kind": "goto", "x_m": "far"}, TypeMismatch, "p.x_m: expected `float`, got `str`"),
        (GOAL, 5, TypeMismatch, "5 is not a Goal; expected its fields seq, kind"),
        (plain("Int"), [1, 2], TypeMismatch, "2 items; Int has the fields value"),
        (plain("Nobody"), 1, NotFound, "type 'Nobody'"),
    ],
)
def test_misfit_is_named_with_expectation(
    resource: Resource, given_value: object, error: type[SwarmError], said: str
) -> None:
    with pytest.raises(error) as caught:
        typed(resource, given_value, "p")
    assert said in str(caught.value)


def test_one_field_of_a_struct_may_be_set() -> None:
    fields = with_field(Goal(1, GoalKind.GOTO, 2.0), "z_m", 7, "nav/goal")
    assert typed(GOAL, fields, "nav/goal.z_m") == Goal(1, GoalKind.GOTO, 2.0, z_m=7.0)
    with pytest.raises(NotFound, match=r"no field 'q'; expected one of seq, kind"):
        with_field(Goal(1, GoalKind.GOTO), "q", 7, "nav/goal")
    with pytest.raises(NotFound, match="no value yet"):
        with_field(None, "z_m", 7, "nav/goal")


@pytest.mark.parametrize(
    ("resource", "error"),
    [
        (SPEED, None),
        (GOAL, None),
        (Resource(path="cmd/goto", kind=Kind.COMMAND, type="Goal"), None),
        (Resource(path="nav/pose", type="Pose", owner="navigator"), Denied),
        (Resource(path="x", kind=Kind.EVENT, type="Text", access="rw"), InvalidInput),
        (Resource(path="x", kind=Kind.BRANCH), InvalidInput),
    ],
)
def test_what_may_be_set(resource: Resource, error: type[SwarmError] | None) -> None:
    if error is None:
        check_settable(resource, "p")
        return
    with pytest.raises(error, match=r"expected|only"):
        check_settable(resource, "p")


@given(st.binary(max_size=40))
def test_any_bytes_are_plain_data_or_invalid_input(data: bytes) -> None:
    try:
        found = unpacked(data, "p")
    except InvalidInput:
        return
    for resource in (SPEED, GOAL, MODE):
        try:
            assert typed(resource, found, "p") is not None
        except SwarmError as error:
            assert str(error)
