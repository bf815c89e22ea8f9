"""Blocks of other packages: found by entry point, checked, played."""

import subprocess
import sys
from pathlib import Path

import pytest

from swarmd.mission.blocks.plugins import BUILT_IN, installed
from swarmware.mission.catalogue import BLOCKS

PACKAGE = """
from typing import Annotated
import msgspec
from swarmware.mission.catalogue import BlockType, Params

class Photo(Params, frozen=True):
    count: Annotated[int, msgspec.Meta(ge=1)] = 1

class TakePhoto:
    spec = BlockType("{name}", "Takes pictures.", Photo, timeout_s=5.0, errors=("no_camera",))

    async def run(self, context):
        context.report(1.0, f"{{context.params.count}} taken")
"""

PROGRAM = """
import asyncio, sys
from pathlib import Path
from swarmd.mission.blocks.plugins import installed
from swarmd.mission.blocks.context import Context
from swarmware.mission.check import check_files
plugins = installed()
for finding in check_files([Path(sys.argv[1])]):
    print(finding)
block = plugins.make("TakePhoto")
said = []
context = Context(None, None, "shoot", plugins.catalogue.types["TakePhoto"].params(count=3),
                  lambda ratio, text: said.append(text))
asyncio.run(block.run(context))
print(said)
"""

MISSION = """{"mission": {
 "s": {"type": "Start", "next": "shoot"},
 "shoot": {"type": "TakePhoto", "count": 3, "next": "e", "on": {"no_camera": "e"}},
 "e": {"type": "End"}}}"""


def package(folder: Path, name: str = "TakePhoto") -> None:
    (folder / "photo.py").write_text(PACKAGE.format(name=name))
    info = folder / "photo-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: photo\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[swarmware.blocks]\nphoto = photo:TakePhoto\n")


def run(folder: Path, mission: str = MISSION) -> subprocess.CompletedProcess[str]:
    (folder / "m.json").write_text(mission)
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, str(folder / "m.json")],
        env={"PYTHONPATH": str(folder), "PATH": ""},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_every_functional_block_of_catalogue_has_class() -> None:
    names = {block.name for block in BLOCKS if not block.control}
    assert {cls.spec.name for cls in BUILT_IN} == names  # type: ignore[attr-defined]  # each has a spec
    for name in names:
        assert installed().make(name).spec.name == name


def test_block_of_another_package_is_checked_and_played(tmp_path: Path) -> None:
    package(tmp_path)
    done = run(tmp_path)
    assert done.stderr == ""
    assert done.stdout == "['shoot: 3 taken']\n"


def test_plugin_parameters_are_checked_like_built_in(tmp_path: Path) -> None:
    package(tmp_path)
    done = run(tmp_path, MISSION.replace('"count": 3', '"count": 0'))
    assert "/mission/shoot/count" in done.stdout
    assert ">= 1" in done.stdout


def test_package_cannot_take_name_of_built_in_block(tmp_path: Path) -> None:
    package(tmp_path, "Land")
    done = run(tmp_path)
    assert "/mission/shoot/type: block type 'TakePhoto': unknown" in done.stdout
    assert "swarmware.blocks:photo (photo:TakePhoto): block type 'Land': defined twice" in done.stdout


def test_without_the_package_its_block_is_unknown() -> None:
    with pytest.raises(KeyError):
        installed().make("TakePhoto")
