"""`swarmctl mission import`: a folder that passes the check, or nothing."""

import json
from pathlib import Path

import pytest

from swarmctl.main import main as swarmctl

DATA = Path(__file__).parents[2] / "data"
PLAN = str(DATA / "plans/mavsdk_qgroundcontrol_sample.plan")


def test_part_that_cannot_be_kept_prevents_import(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert swarmctl(["mission", "import", PLAN, "-o", str(tmp_path / "m")]) == 7
    assert f"{PLAN}:55: item 3 (command 2000, IMAGE_START_CAPTURE)" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_imported_plan_passes_the_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(tmp_path / "m")
    assert swarmctl(["--json", "mission", "import", PLAN, "--skip-unsupported", "-o", folder]) == 0
    printed = capsys.readouterr()
    assert "item 3 (command 2000" in printed.err
    assert json.loads(printed.out)["items"] == 6
    assert swarmctl(["mission", "check", folder]) == 0
    assert swarmctl(["mission", "import", PLAN, "--skip-unsupported", "-o", folder]) == 1


def test_plan_without_home_needs_an_origin(tmp_path: Path) -> None:
    source = tmp_path / "a.txt"
    source.write_text("QGC WPL 110\n0 1 3 22 0 0 0 0 0 0 9 1\n1 0 3 16 0 0 0 0 47 8 9 1\n")
    words = ["mission", "import", str(source), "-o", str(tmp_path / "m")]
    assert swarmctl(words) == 7
    assert swarmctl([*words, "--origin", "47", "8"]) == 0
    mission = json.loads((tmp_path / "m/mission.json").read_text())
    assert "nav/origin.lat_deg > 46.9999500" in mission["requires"]


def test_plan_far_from_the_origin_is_refused(tmp_path: Path) -> None:
    words = ["mission", "import", PLAN, "--skip-unsupported", "-o", str(tmp_path / "m")]
    assert swarmctl([*words, "--origin", "0", "0"]) == 7
    assert list(tmp_path.iterdir()) == []


def test_missing_file_is_not_found(tmp_path: Path) -> None:
    assert swarmctl(["mission", "import", str(tmp_path / "none.plan")]) == 6
