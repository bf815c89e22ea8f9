"""Payload types described for others: what is described is a class again there, and garbage is refused."""

import enum
from importlib import import_module
from pkgutil import iter_modules
from typing import Annotated, Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

import swarmware.types
from swarmware.errors import WireError
from swarmware.types import registry
from swarmware.types.described import class_of
from swarmware.types.description import (
    STRUCTS_LIMIT,
    FieldDescription,
    StructDescription,
    TypeDescription,
    describe,
)
from swarmware.types.units import unit_of
from swarmware.types.vehicle import Pose, VehicleState


class Sky(enum.Enum):
    CLEAR = "clear"
    CLOUDED = "clouded"


class Gust(msgspec.Struct, array_like=True):
    at_s: float
    speed_m_s: float = 1.0


class Weather(msgspec.Struct, rename="camel"):
    """Weather at one place.

    More of it.
    """

    temp_degc: float
    """Of the air, in the shade."""
    sky: Sky = Sky.CLEAR
    gusts: list[Gust] = []
    by_name: dict[str, tuple[int, Gust]] = {}
    next: "Weather | None" = None
    level: Annotated[int, msgspec.Meta(ge=0, le=5)] = 3


def every_type() -> list[type[msgspec.Struct]]:
    areas = [import_module(f"swarmware.types.{area.name}") for area in iter_modules(swarmware.types.__path__)]
    found = [value for area in areas for value in vars(area).values() if isinstance(value, type)]
    return [cls for cls in found if issubclass(cls, msgspec.Struct) and registry.known(cls)]


def again(cls: type[msgspec.Struct]) -> type[msgspec.Struct]:
    """The class that another node makes of the description, which crosses the wire and a file."""
    sent = registry.decode(TypeDescription, registry.encode(describe(cls)))
    kept = msgspec.json.decode(msgspec.json.encode(sent), type=TypeDescription)
    assert kept == sent == describe(cls)
    return class_of(kept)


@pytest.mark.parametrize("cls", every_type(), ids=lambda cls: cls.__name__)
def test_every_common_type_is_described_and_rebuilt(cls: type[msgspec.Struct]) -> None:
    made = again(cls)
    assert [field.encode_name for field in msgspec.structs.fields(made)] == [
        field.encode_name for field in msgspec.structs.fields(cls)
    ]
    assert made.__struct_config__.array_like == cls.__struct_config__.array_like


def test_described_values_have_names_at_any_depth() -> None:
    value = Weather(1.5, Sky.CLOUDED, [Gust(2.0, 3.0)], {"a": (1, Gust(4.0))}, Weather(2.0), level=4)
    found = msgspec.to_builtins(registry.decode(again(Weather), registry.encode(value)))
    assert found["tempDegc"] == 1.5
    assert found["sky"] == "clouded"
    assert found["byName"]["a"][1] == [4.0, 1.0]
    assert found["next"]["tempDegc"] == 2.0
    pose = registry.decode(again(Pose), registry.encode(Pose(1.0, 2.0)))
    assert (pose.x_m, pose.qw) == (1.0, 1.0)  # type: ignore[attr-defined]  # made at run time


def test_defaults_ranges_and_meanings_are_described() -> None:
    top = describe(Weather).top
    assert top.meaning == "Weather at one place."
    fields = {field.name: field for field in top.fields}
    assert fields["tempDegc"].meaning == "Of the air, in the shade."
    assert (fields["level"].low, fields["level"].high) == (0, 5)
    assert msgspec.msgpack.decode(fields["level"].default) == 3
    with pytest.raises(WireError, match="level"):
        registry.decode(again(Weather), msgspec.msgpack.encode({"tempDegc": 1.0, "level": 9}))


def test_open_vocabulary_takes_word_of_later_version() -> None:
    made = again(VehicleState)
    assert (
        msgspec.to_builtins(registry.decode(made, msgspec.msgpack.encode([True, False, "hover"])))[2]
        == "hover"
    )


EXPRESSIONS = st.one_of(
    st.sampled_from(
        [
            "float",
            "list[T]",
            "T",
            "None",
            "dict[list[int], T]",
            "tuple[]",
            "tuple[...]",
            "list[int, int]",
            "1 | 2",
        ]
    ),
    st.sampled_from(
        ["__import__('os')", "list[", "int()", "a.b", "Any | T", "'a' | 3", "-1", "[" * 90, "True"]
    ),
    st.text(min_size=1, max_size=30),
)
FIELDS = st.builds(
    FieldDescription,
    st.one_of(st.sampled_from(["a", "b", "class", "_a", "a b", "__doc__"]), st.text(min_size=1, max_size=5)),
    EXPRESSIONS,
    st.booleans(),
    st.one_of(st.binary(max_size=6), st.sampled_from([b"\x90", b"\x80", b"\x01", b"\xa1a"])),
    st.one_of(st.none(), st.integers(), st.floats()),
    st.one_of(st.none(), st.integers(), st.floats()),
)
STRUCTS = st.builds(
    StructDescription,
    st.sampled_from(["T", "U", "not a name", "class"]),
    st.lists(FIELDS, max_size=4).map(tuple),
    st.just(""),
    st.booleans(),
)


@given(st.lists(STRUCTS, min_size=1, max_size=3).map(tuple))
def test_invalid_description_is_refused_and_never_run(structs: Any) -> None:
    try:
        made = class_of(TypeDescription(structs))
    except WireError:
        return
    msgspec.msgpack.Decoder(made)


def test_types_that_nest_without_end_are_refused() -> None:
    chain = [
        StructDescription(f"T{number}", (FieldDescription("a", f"T{number + 1}"),)) for number in range(60)
    ]
    with pytest.raises(WireError, match="nested deeper"):
        class_of(TypeDescription((*chain, StructDescription("T60"))))
    assert len(chain) < STRUCTS_LIMIT
    with pytest.raises(WireError):
        registry.decode(TypeDescription, msgspec.msgpack.encode([[["T", []]] * (STRUCTS_LIMIT + 1)]))


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("x_m", "m"),
        ("vx_m_s", "m/s"),
        ("wz_rad_s", "rad/s"),
        ("az_m_s2", "m/s²"),
        ("lat_deg", "°"),
        ("armed", ""),
    ],
)
def test_the_end_of_a_name_is_its_unit(name: str, unit: str) -> None:
    assert unit_of(name) == unit


def test_whole_number_with_short_name_is_count() -> None:
    assert (unit_of("pages_s", whole=True), unit_of("stamp_ns", whole=True)) == ("", "ns")
