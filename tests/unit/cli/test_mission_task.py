"""One mission file: `start` sends exactly the files that `check` reads."""

import io
import re
from pathlib import Path
from typing import Any

import pytest
from tests.unit.mission.nets import net

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.mission.task import check_all, check_missions, task
from swarmctl.terminal.output import Output
from swarmware.errors import ConfigError, NotFound
from swarmware.mission.assignment import Platform, assign
from swarmware.mission.check import check_folder
from swarmware.mission.finding import sound
from swarmware.mission.folder import Folder, from_files
from swarmware.model.platform_kind import PlatformKind

ROOT = Path(__file__).parents[3]
EXAMPLE = re.findall(r"```json\n(.*?)```", (ROOT / "share/doc/missions.md").read_text(), re.DOTALL)[0]
SWARM = [
    Platform("uav1", PlatformKind.UAV),
    Platform("ugv1", PlatformKind.UGV),
    Platform("gcs", PlatformKind.GCS),
]
HOP = net(s="Start>a", a="Arm>t", t={"type": "Takeoff", "alt": 3, "next": "l"}, l="Land>e", e="End")


def sent(path: Path, *params: str) -> Folder:
    """The mission that a ground station makes of what `start` sends."""
    order = task(str(path), (), params)
    return from_files(order.files, order.name)


@pytest.fixture
def crowd(tmp_path: Path) -> Path:
    """A folder with a mission of its own and files that are no missions."""
    (tmp_path / "mission.toml").write_text(
        'name = "other"\n[[roles]]\nname = "a"\nfile = "a.json"\nkinds=["uav"]\n'
    )
    (tmp_path / "a.json").write_text(net(s="Start>e", e="End"))
    (tmp_path / "package.json").write_text('{"name": "no mission"}')
    (tmp_path / "latin.json").write_bytes(b'{"comment": "caf\xe9"}')
    (tmp_path / "hop.json").write_text(HOP)
    return tmp_path


def test_file_is_started_alone_whatever_lies_beside_it(crowd: Path) -> None:
    order = task(str(crowd / "hop.json"), (), ())
    assert [(file.name, file.text) for file in order.files] == [("hop.json", HOP)]
    folder = sent(crowd / "hop.json")
    assert sound(check_folder(folder))
    assert [m.platform for m in assign(folder, SWARM, {}).members] == ["uav1"]


@pytest.mark.parametrize("name", ["", "mission.toml"])
def test_folder_starts_with_files_of_its_roles(crowd: Path, name: str) -> None:
    order = task(str(crowd / name), (), ())
    assert {file.name for file in order.files} == {"mission.toml", "a.json"}
    assert order.name == crowd.name


def test_check_and_start_give_the_same_verdict(crowd: Path) -> None:
    (crowd / "round.json").write_text(net(s="Start>a", a="Takeoff>b", b="Wait>b", e="End"))
    for name in ("hop.json", "round.json", "package.json", ""):
        (verdict,) = check_all([str(crowd / name)])
        ours = [(f.rule, f.pointer, f.line, f.message) for f in verdict.findings]
        theirs = [(f.rule, f.pointer, f.line, f.message) for f in check_folder(sent(crowd / name))]
        assert ours == theirs


def test_non_text_file_is_named_with_line(crowd: Path) -> None:
    with pytest.raises(ConfigError, match=r"latin\.json: line 1: cannot be read: not UTF-8"):
        task(str(crowd / "latin.json"), (), ())
    (verdict,) = check_all([str(crowd / "latin.json")])
    assert not verdict.sound
    assert "not UTF-8" in verdict.findings[0].message
    (crowd / "a.json").write_bytes(b"\xff")
    with pytest.raises(ConfigError, match=r"a\.json: line 1: cannot be read: not UTF-8"):
        task(str(crowd), (), ())


def test_a_folder_without_a_manifest_is_not_found(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(HOP)
    with pytest.raises(NotFound, match=r"no mission\.toml"):
        task(str(tmp_path), (), ())


def test_example_of_documentation_checks_and_starts_as_file(tmp_path: Path) -> None:
    (tmp_path / "look.json").write_text(EXAMPLE)
    (verdict,) = check_all([str(tmp_path / "look.json")])
    assert (verdict.sound, verdict.findings) == (True, [])
    folder = sent(tmp_path / "look.json")
    changed: dict[str, Any] = {"height_m": 8.0}
    (part,) = assign(folder, SWARM, changed).member_assignments
    assert part.member.platform == "uav1"
    assert part.binding.params == changed


def test_check_prints_mission_name_of_present_folder(crowd: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    monkeypatch.chdir(crowd)
    check_missions([".", "mission.toml", "a.json"], Output(CliSettings(), out))
    assert [line.split()[0] for line in out.getvalue().splitlines()] == [
        "MISSION",
        crowd.name,
        crowd.name,
        "a.json",
    ]
