"""Values of a vocabulary that this version does not know: kept, shown and passed on, never an end."""

import inspect
from enum import Enum, StrEnum
from importlib import import_module
from pkgutil import iter_modules
from typing import get_args, get_type_hints

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

import swarmware.types
from swarmware.errors import WireError
from swarmware.model.open_enum import OpenEnum
from swarmware.model.resource import Kind
from swarmware.types import registry
from swarmware.types.health import Fault, Phase
from swarmware.types.mission import MissionPhase, MissionState
from swarmware.types.navigation import NavState, NavStatus
from swarmware.types.tree import Quality, TreeEntry

CLOSED = {Phase}
"""The monitor computes with it: a fault with another phase, of its own journal, is refused."""


def vocabularies() -> list[type[Enum]]:
    """The enumerations of strings in fields of payload types."""
    areas = [import_module(f"swarmware.types.{area.name}") for area in iter_modules(swarmware.types.__path__)]
    found: set[type[Enum]] = set()
    for area in areas:
        for _, cls in inspect.getmembers(area, inspect.isclass):
            if not issubclass(cls, msgspec.Struct) or cls.__module__ != area.__name__:
                continue
            for field in get_type_hints(cls).values():
                for part in (field, *get_args(field)):
                    if inspect.isclass(part) and issubclass(part, StrEnum):
                        found.add(part)
    return sorted(found - CLOSED, key=lambda cls: cls.__name__)


@pytest.mark.parametrize("cls", vocabularies(), ids=lambda cls: cls.__name__)
def test_every_vocabulary_keeps_value_of_later_version(cls: type[Enum]) -> None:
    assert issubclass(cls, OpenEnum)
    value = msgspec.msgpack.decode(b"\xa5later", type=cls)
    assert (value, str(value), value.known) == ("later", "later", False)
    assert value not in list(cls)
    assert msgspec.msgpack.encode(value) == b"\xa5later"


@given(st.text(max_size=40))
def test_payload_is_kept_beside_unknown_value(word: str) -> None:
    payload = msgspec.msgpack.encode([3, word, 1.5, 0.25, "note", word, 8.5])
    status = registry.decode(NavStatus, payload)
    assert (status.goal_seq, status.state, status.error, status.distance_m) == (3, word, word, 1.5)
    assert registry.encode(status) == payload


def test_known_value_is_its_member_and_its_string() -> None:
    state = registry.decode(NavStatus, msgspec.msgpack.encode([3, "arrived"])).state
    assert state is NavState.ARRIVED
    assert (state, state.known) == ("arrived", True)
    assert f"{state}" == "arrived"
    assert msgspec.json.encode(TreeEntry("/a/b", Kind.BOARD, "Text")).count(b'"none"') == 2
    assert Quality("none") is Quality.NONE


@pytest.mark.parametrize("value", [5, None, [], b"idle", 1.5])
def test_a_value_that_is_no_text_is_refused(value: object) -> None:
    with pytest.raises(WireError, match=r"NavStatus.*Expected `str`"):
        registry.decode(NavStatus, msgspec.msgpack.encode([3, value]))


def test_phase_without_number_on_wire_goes_as_text() -> None:
    state = MissionState(1, "", MissionPhase("regrouping"))
    data, codec = registry.pack(state)
    assert registry.decode(MissionState, data, codec) == state


def test_what_is_computed_with_stays_closed() -> None:
    for level, phase in (("grave", "confirmed"), ("warn", "resting")):
        row = msgspec.msgpack.encode(["check", "state", level, phase, 1, 2, 3])
        with pytest.raises(WireError, match="Invalid enum value"):
            registry.decode(Fault, row)
