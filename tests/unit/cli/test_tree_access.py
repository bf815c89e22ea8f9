"""Values of platforms that are lost: given at once, and never without a word."""

from types import SimpleNamespace
from typing import Any, cast

from swarmctl.resources.access import read
from swarmctl.session.session import Session
from swarmware.types import registry
from swarmware.types.scalar import Float
from swarmware.types.tree import Quality, TreeGet, TreeValue, ValueSource

COPY = "/gcs/sys/tree/get"


class Node:
    """Answers as the tree of a ground station; counts the questions."""

    def __init__(self, quality: str, age_s: float | None) -> None:
        data = registry.encode(Float(0.5))
        self.value = TreeValue(
            "/uav3/power/fuel", "Float", data, 1, 1, 1, age_s, Quality(quality), source=ValueSource.MIRROR
        )
        self.asked: list[str] = []

    async def in_reach(self, platform: str) -> bool:
        assert platform == "uav3"
        return self.value.quality is not Quality.LOST

    async def ask(self, path: str, request: TreeGet, _reply: type[Any], about: str) -> TreeValue:
        assert about == ("" if self.value.quality is Quality.LOST else request.path)
        self.asked.append(path)
        return self.value

    def link(self) -> Session:
        return cast(
            Session, SimpleNamespace(here="gcs", ask=self.ask, in_reach=self.in_reach, age_s=lambda *_: None)
        )


async def test_the_last_value_of_a_lost_platform_is_given_without_asking_it_again() -> None:
    node = Node("lost", 42.4)
    found = await read(node.link(), "/uav3/power/fuel")
    assert found.value == 0.5
    assert node.asked == [COPY]
    assert found.warning == "/uav3/power/fuel: lost; this is the last value, 42 s old"
    unknown = await read(Node("lost", None).link(), "/uav3/power/fuel")
    assert unknown.warning.endswith("of unknown age")


async def test_an_old_mirror_of_a_platform_in_reach_is_held_against_its_owner() -> None:
    node = Node("stale", 42.4)
    found = await read(node.link(), "/uav3/power/fuel")
    assert node.asked == [COPY, "/uav3/sys/tree/get"]
    assert found.warning == ""
