"""A block of a package that is installed beside the system: found, checked and played by the real daemon."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.integration.mission.swarm import on_uvloop, swarm

from swarmware.errors import MissionError
from swarmware.types.mission import MissionFile, MissionTask, TaskAnswer

PACKAGE = """
from typing import Annotated
import msgspec
from swarmware.mission.catalogue import BlockType, Params
from swarmware.mission.plugin import BlockError

TAKEN = []

class Photo(Params, frozen=True):
    count: Annotated[int, msgspec.Meta(ge=1)] = 1

class TakePhoto:
    spec = BlockType("TakePhoto", "Takes it.", Photo, timeout_s=5.0, kinds=("uav",), errors=("no_camera",))

    async def run(self, context):
        if context.params.count > 5:
            raise BlockError("no_camera", "the film is full")
        TAKEN.append((context.module.platform, context.block_id, context.params.count))
"""


def shoot(count: int) -> MissionTask:
    text = f"""{{"mission": {{
        "s": {{"type": "Start", "next": "shoot"}},
        "shoot": {{"type": "TakePhoto", "count": {count}, "next": "e", "on": {{"no_camera": "h"}}}},
        "h": {{"type": "Hold", "next": "f"}},
        "e": {{"type": "End"}},
        "f": {{"type": "End", "result": "failed"}}
    }}}}"""
    return MissionTask("shoot", (MissionFile("shoot.json", text),))


@pytest.fixture
def photo(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The package, where the interpreter finds it."""
    folder = tmp_path_factory.mktemp("site")
    info = folder / "photo-1.0.dist-info"
    info.mkdir()
    (folder / "photo.py").write_text(PACKAGE)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: photo\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[swarmware.blocks]\nphoto = photo:TakePhoto\n")
    monkeypatch.syspath_prepend(folder)
    yield
    sys.modules.pop("photo", None)


@on_uvloop
async def test_block_of_another_package_is_played_by_daemon(tmp_path: Path, photo: None) -> None:
    async with swarm(tmp_path, "gcs", "uav1", "ugv1") as s:
        package: Any = sys.modules["photo"]
        answer = await s.ask("sys/mission/task", shoot(3), TaskAnswer)
        # the default role is of the kinds that can do every block
        assert [order.platform for order in answer.orders] == ["uav1"]
        await s.until(lambda: s["uav1"].history[-1:] == ["done"])
        assert package.TAKEN == [("uav1", "shoot", 3)]
        with pytest.raises(MissionError, match=r"/mission/shoot/count: .*>= 1"):
            await s.ask("sys/mission/task", shoot(0), TaskAnswer)
        # its error takes its own successor
        await s.ask("sys/mission/task", shoot(9), TaskAnswer)
        await s.until(lambda: s["uav1"].history[-1:] == ["failed"])
        assert s["uav1"].kinds[0] == "hold"
        assert package.TAKEN == [("uav1", "shoot", 3)]
