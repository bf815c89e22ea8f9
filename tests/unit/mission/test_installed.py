"""The catalogue of installed block types has the types of packages beside the built-in ones."""

import logging
import re
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
import pytest

from swarmd.mission.blocks.plugins import installed as installed_plugins
from swarmware.mission import installed
from swarmware.mission.binding import Binding
from swarmware.mission.catalogue import BLOCKS, BlockType, Params
from swarmware.mission.check import check_text


class Point(NamedTuple):
    """An entry point of a package."""

    name: str
    content: Any
    value: str = "package:Class"

    def load(self) -> Any:
        if isinstance(self.content, Exception):
            raise self.content
        return self.content


class Area(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part of a parameter."""

    width_m: Annotated[float, msgspec.Meta(gt=0)]


class Field(Params, frozen=True):
    """Parameters of every sort that a package may have."""

    area: Area
    label: Annotated[str, msgspec.Meta(description="a label")] | None = None
    code: Literal["1", "2"] = "1"
    by_crop: dict[str, Area] = msgspec.field(default_factory=dict)
    amount_l: float = 1.0

    def __post_init__(self) -> None:
        if self.amount_l == 0:
            raise ZeroDivisionError("amount")


class Spray:
    spec = BlockType("Spray", "Sprays a field.", Field, errors=("empty",), aliases=(("amount", "amount_l"),))

    async def run(self, context: Any) -> None:
        """Spray the field."""


def install(monkeypatch: pytest.MonkeyPatch, *points: Point) -> None:
    monkeypatch.setattr(installed, "entry_points", lambda group: points)


def block(**spec: Any) -> type:
    """A class of a package whose type has these fields."""
    fields = {"name": "Other", "purpose": "Does it.", **spec}
    return type("Other", (), {"spec": BlockType(**fields), "run": Spray.run})


def test_block_of_package_stands_beside_built_in_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, Point("spray", Spray))
    found = installed.installed()
    assert found.find("Spray") is Spray.spec
    assert found.unusable == ()
    assert set(found.types) == {"Spray", *(block.name for block in BLOCKS)}
    assert isinstance(installed_plugins().make("Spray"), Spray)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (object(), "expected a class with `spec: BlockType`"),
        (str, "expected a class with `spec: BlockType`"),
        (type("NoRun", (), {"spec": Spray.spec}), "async def run"),
        (type("Sync", (), {"spec": Spray.spec, "run": lambda self, context: None}), "async def run"),
        (
            ModuleNotFoundError("No module named 'spray'"),
            "cannot be imported: ModuleNotFoundError: No module",
        ),
        (ZeroDivisionError("division by zero"), "cannot be imported: ZeroDivisionError"),
        (block(name="Land"), "block type 'Land': defined twice, it is built-in; expected another name"),
        (block(name="take photo"), "spec.name 'take photo': expected one word, such as TakePhoto"),
        (block(params=Area), "spec.params .*Area.*: expected a subclass of .*Params"),
        (block(kinds=("plane",)), "spec.kinds: unknown kind 'plane'; expected some of uav, ugv, usv, gcs"),
        (block(kinds="uav"), "spec.kinds 'uav': expected a tuple of texts"),
        (block(errors="empty"), "spec.errors 'empty': expected a tuple of texts"),
        (block(timeout_s=-1.0), "spec.timeout_s -1.0: expected seconds above 0, or None"),
        (block(control=True), "spec.control and spec.instant: only built-in blocks have them"),
        (block(aliases=(("a", "b"),)), "spec.aliases: 'a' is for 'b', not a parameter; expected one of none"),
        (
            block(params=msgspec.defstruct("P", [("next", int)], bases=(Params,), frozen=True)),
            "parameter 'next'",
        ),
    ],
)
def test_unusable_block_is_named_and_stops_none(
    content: Any, reason: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    install(monkeypatch, Point("bad", content), Point("spray", Spray))
    found = installed.installed()
    (text,) = found.unusable
    assert text.startswith("swarmware.blocks:bad (package:Class): ")
    assert re.search(reason, text), text
    assert found.find("Spray") is Spray.spec
    assert set(found.types) == {"Spray", *(block.name for block in BLOCKS)}
    with caplog.at_level(logging.ERROR):
        assert installed_plugins().make("Land")
    assert text in caplog.text


def test_two_packages_cannot_have_one_name(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, Point("a", Spray, "one:Spray"), Point("b", Spray, "two:Spray"))
    (text,) = installed.installed().unusable
    assert (
        "swarmware.blocks:b (two:Spray): block type 'Spray': defined twice, it is a block of one:Spray"
        in text
    )


def test_mission_with_unusable_block_names_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, Point("sprya", ImportError("no pump")))
    (finding, *_) = findings(type="Spray", next="e")
    assert finding[0] == "/mission/b"
    assert "block type 'Spray': unknown; nearest known: " in finding[1]
    assert (
        "not available: swarmware.blocks:sprya (package:Class): cannot be imported: ImportError: no pump"
        in finding[1]
    )


def findings(**body: Any) -> list[tuple[str, str]]:
    text = msgspec.json.encode(
        {"mission": {"s": {"type": "Start", "next": "b"}, "b": body, "e": {"type": "End"}}}
    ).decode()
    _, found = check_text(text, "m.json", Binding(), installed.installed())
    return [(finding.pointer.removesuffix("/type"), finding.message) for finding in found]


@pytest.mark.parametrize(
    ("params", "pointer", "message"),
    [
        ({}, "", "parameter 'area' of Spray: missing; expected an object"),
        (
            {"area": {"width_m": 0}},
            "/area/width_m",
            "parameter 'area.width_m' of Spray: expected `float` > 0.0",
        ),
        (
            {"area": {"width": 1}},
            "/area/width",
            "parameter 'area.width' of Spray: unknown; did you mean width_m?",
        ),
        ({"area": {}}, "/area/width_m", "parameter 'area.width_m' of Spray: missing; expected a number"),
        (
            {"area": {"width_m": 1}, "by_crop": {"rye": {"width_m": 1}, "oat": {"width_m": "x"}}},
            "/by_crop/oat/width_m",
            "parameter 'by_crop.oat.width_m' of Spray: expected `float`, got `str`",
        ),
        (
            {"area": {"width_m": 1}, "code": "3"},
            "/code",
            "parameter 'code' of Spray: ",
        ),
        (
            {"area": {"width_m": 1}, "amout": 1},
            "/amout",
            "parameter 'amout' of Spray: unknown; nearest known: amount_l",
        ),
        (
            {"area": {"width_m": 1}, "amount": "x"},
            "/amount",
            "parameter 'amount' of Spray: expected `float`, got `str`",
        ),
        (
            {"area": {"width_m": 1}, "amount": 0},
            "",
            "Spray: its parameters cannot be checked: ZeroDivisionError: amount",
        ),
        (
            {"area": {"width_m": 1}, "on": {"full": "e"}},
            "/on/full",
            "a Spray does not end with 'full'; expected timeout, error, empty",
        ),
    ],
)
def test_package_block_error_is_named_precisely(
    params: dict[str, Any], pointer: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(monkeypatch, Point("spray", Spray))
    (found,) = findings(type="Spray", next="e", **params)
    assert found[0] == f"/mission/b{pointer}"
    assert found[1].startswith(message), found[1]


@pytest.mark.parametrize("params", [{"label": "5"}, {"code": "2"}, {"amount": "5"}, {"label": None}])
def test_numeric_text_stays_text_where_expected(
    params: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    install(monkeypatch, Point("spray", Spray))
    assert findings(type="Spray", next="e", area={"width_m": 2.5}, **params) == []
