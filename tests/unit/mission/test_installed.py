"""The catalogue of installed block types: those of packages beside the built-in ones."""

from typing import Any, NamedTuple

import pytest

from swarmware.errors import MissionError
from swarmware.mission import installed
from swarmware.mission.catalogue import BLOCKS, BlockType


class Point(NamedTuple):
    """An entry point of a package."""

    name: str
    content: Any

    def load(self) -> Any:
        return self.content


class Spray:
    spec = BlockType("Spray", "Sprays a field.")


class Land:
    spec = BlockType("Land", "Lands in another way.")


def install(monkeypatch: pytest.MonkeyPatch, *points: Point) -> None:
    monkeypatch.setattr(installed, "entry_points", lambda group: points)


def test_a_block_of_a_package_stands_beside_the_built_in_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, Point("spray", Spray))
    found = installed.installed()
    assert found.find("Spray") is Spray.spec
    assert set(found.types) == {"Spray", *(block.name for block in BLOCKS)}


@pytest.mark.parametrize("content", [object(), str])
def test_what_is_no_block_is_named_with_its_entry_point(
    monkeypatch: pytest.MonkeyPatch, content: object
) -> None:
    install(monkeypatch, Point("spray", content))
    with pytest.raises(
        MissionError, match=r"swarmware\.blocks:spray: expected a class with `spec: BlockType`"
    ):
        installed.installed()


def test_a_name_of_a_built_in_block_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, Point("land", Land))
    with pytest.raises(MissionError, match="'Land': defined twice"):
        installed.installed()
