"""Values of types inside types from plain data, as an operator enters them."""

from typing import Any

import msgspec
import pytest

from swarmware.errors import TypeMismatch
from swarmware.types.typed_value import value_of


class Gust(msgspec.Struct, array_like=True, frozen=True):
    speed_m_s: float
    from_rad: float = 0.0


class Nested(msgspec.Struct, frozen=True):
    inner: list["Nested"] = []


class Weather(msgspec.Struct, frozen=True):
    temp_degc: float
    gusts: list[Gust] = []
    strongest: Gust | None = None
    by_name: dict[str, Gust] = {}
    two: tuple[Gust, float] | None = None
    kind_: str = msgspec.field(default="", name="kind")


@pytest.mark.parametrize(
    ("plain", "expected"),
    [
        ({"temp_degc": 1, "gusts": [{"speed_m_s": 3}]}, Weather(1.0, [Gust(3.0)])),
        ({"temp_degc": 1, "gusts": [[3, 0.5]]}, Weather(1.0, [Gust(3.0, 0.5)])),
        ({"temp_degc": 1, "strongest": {"speed_m_s": 3}}, Weather(1.0, strongest=Gust(3.0))),
        ({"temp_degc": 1, "strongest": None}, Weather(1.0)),
        ({"temp_degc": 1, "by_name": {"a": {"speed_m_s": 3}}}, Weather(1.0, by_name={"a": Gust(3.0)})),
        ({"temp_degc": 1, "two": [{"speed_m_s": 3}, 4]}, Weather(1.0, two=(Gust(3.0), 4.0))),
        ({"temp_degc": 1, "kind": "dry"}, Weather(1.0, kind_="dry")),
        ([1, [[3]]], Weather(1.0, [Gust(3.0)])),
    ],
)
def test_nested_types_are_given_by_fields(plain: Any, expected: Weather) -> None:
    assert value_of(Weather, plain, "p") == expected


@pytest.mark.parametrize(
    ("plain", "said"),
    [
        ({"temp_degc": 1, "gusts": [{"speed": 3}]}, "p.gusts.0: no field 'speed' in Gust; expected some of"),
        ({"temp_degc": 1, "gusts": [{"speed_m_s": "x"}]}, "p.gusts.0.speed_m_s: expected `float`, got `str`"),
        ({"temp_degc": 1, "gusts": 3}, "p.gusts: expected `array`, got `int`"),
        ({"temp_degc": 1, "strongest": {}}, "p.strongest: field 'speed_m_s' of Gust is missing"),
        ({"temp_degc": 1, "kind_": "dry"}, "no field 'kind_' in Weather"),
    ],
)
def test_misfit_inside_is_named_by_place(plain: Any, said: str) -> None:
    with pytest.raises(TypeMismatch) as caught:
        value_of(Weather, plain, "p")
    assert said in str(caught.value)


def test_values_that_are_nested_too_deep_are_refused() -> None:
    plain: dict[str, Any] = {}
    for _ in range(3000):
        plain = {"inner": [plain]}
    with pytest.raises(TypeMismatch, match="nested too deep"):
        value_of(Nested, plain, "p")
