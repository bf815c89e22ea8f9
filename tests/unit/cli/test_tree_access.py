"""Values of platforms that are lost: given at once, and never without a word."""

from typing import Any

from tests.unit.cli.session import ScriptedSession

from swarmctl.resources.access import read
from swarmware.types import registry
from swarmware.types.scalar import Float
from swarmware.types.tree import Quality, TreeValue, ValueSource

COPY = "/gcs/sys/tree/get"


class Node(ScriptedSession):
    """Answers as the tree of a ground station; counts the questions."""

    def __init__(self, quality: str, age_s: float | None) -> None:
        super().__init__({})
        data = registry.encode(Float(0.5))
        self.value = TreeValue(
            "/uav3/power/fuel", "Float", data, 1, 1, 1, age_s, Quality(quality), source=ValueSource.MIRROR
        )

    async def in_reach(self, platform: str) -> bool:
        assert platform == "uav3"
        return self.value.quality is not Quality.LOST

    async def ask(self, path: str, value: Any, reply: type[Any], *, about: str = "", **_: Any) -> Any:
        assert about == ("" if self.value.quality is Quality.LOST else value.path)
        self.asked.append(path)
        return self.value


async def test_lost_platforms_last_value_needs_no_request() -> None:
    node = Node("lost", 42.4)
    found = await read(node, "/uav3/power/fuel")
    assert found.value == 0.5
    assert node.asked == [COPY]
    assert found.warning == "/uav3/power/fuel: lost; this is the last value, 42 s old"
    unknown = await read(Node("lost", None), "/uav3/power/fuel")
    assert unknown.warning.endswith("of unknown age")


async def test_old_mirror_is_checked_with_its_owner() -> None:
    node = Node("stale", 42.4)
    found = await read(node, "/uav3/power/fuel")
    assert node.asked == [COPY, "/uav3/sys/tree/get"]
    assert found.warning == ""
