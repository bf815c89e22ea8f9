"""`swarmctl doctor` on the keys of a node: each state of the folder, with what to do."""

import time
from pathlib import Path

import pytest

from swarmctl.commands.doctor.keys_check import check_keys
from swarmware.runtime.filewriter import replace_file
from swarmware.transport.security.root import Root, make_swarm

NOW_S = time.time() + 3600.0
"""After the files of the tests are written, however long the run takes."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make_swarm(tmp_path, ["gcs", "uav1"])
    return tmp_path / "uav1"


def test_the_keys_of_a_member_are_well(folder: Path) -> None:
    assert [found.verdict for found in check_keys(folder, "uav1", NOW_S)] == ["ok"]


def test_node_without_keys_gets_both_ways_to_them(tmp_path: Path) -> None:
    (found,) = check_keys(tmp_path / "none", "uav1", NOW_S)
    assert found.verdict == "warning" and "serves only this computer" in found.text
    assert "keys init" in found.advice and "keys invite uav1" in found.advice


def test_keys_that_others_can_read_are_an_error(folder: Path) -> None:
    (folder / "node.key").chmod(0o644)
    found = next(check_keys(folder, "uav1", NOW_S))
    assert found.verdict == "error" and found.advice.startswith("chmod 0600")


def test_folder_of_another_user_is_unneeded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.access", lambda path, mode: False)  # root may do everything
    (found,) = check_keys(folder, "uav1", NOW_S)
    assert found.verdict == "ok" and "not readable by this user" in found.text


def test_platform_that_is_not_on_roster_is_error(folder: Path) -> None:
    found = next(check_keys(folder, "uav7", NOW_S))
    assert found.verdict == "error" and "uav7 is not on the roster" in found.text
    assert "keys join --replace" in found.advice


def test_a_revoked_platform_is_an_error(folder: Path) -> None:
    signed = Root.load(folder.parent).revoke("uav1")
    replace_file(folder / "roster.json", signed)
    found = next(check_keys(folder, "uav1", NOW_S))
    assert found.verdict == "error" and "was revoked" in found.text


def test_the_key_of_another_node_is_an_error(folder: Path) -> None:
    replace_file(folder / "node.key", (folder.parent / "gcs/node.key").read_bytes(), mode=0o600)
    found = next(check_keys(folder, "uav1", NOW_S))
    assert found.verdict == "error" and "not the key" in found.text


@pytest.mark.parametrize("name", ["root.pub", "roster.json", "node.key"])
def test_damaged_file_is_error_that_names_it(folder: Path, name: str) -> None:
    replace_file(folder / name, b"x", mode=0o600)
    found = next(check_keys(folder, "uav1", NOW_S))
    assert found.verdict == "error" and str(folder) in found.text


def test_a_root_of_another_swarm_is_an_error(folder: Path, tmp_path: Path) -> None:
    make_swarm(tmp_path / "other", ["uav1"])
    replace_file(folder / "root.pub", (tmp_path / "other/root.pub").read_bytes())
    found = next(check_keys(folder, "uav1", NOW_S))
    assert found.verdict == "error" and "not signed by this swarm's root" in found.text


def test_a_clock_before_the_roster_is_a_warning(folder: Path) -> None:
    late = [found for found in check_keys(folder, "uav1", 0.0) if found.verdict == "warning"]
    assert [found.text.split(",")[0] for found in late] == ["the clock says 1970-01-01T00:00:00Z"]
    assert "set the clock" in late[0].advice
