"""lab.json and how a running lab is found."""

import io
import json
import os
import subprocess
from pathlib import Path

import pytest

from swarmctl.commandline.settings import CliSettings
from swarmctl.session import labs, processes
from swarmctl.session.labs import LabNode, LabState
from swarmctl.session.session import config_dir
from swarmctl.terminal.output import Output
from swarmlab.run.lifecycle import end_labs
from swarmware.errors import ConfigError, Denied, InvalidInput, NotFound
from swarmware.model.platform_kind import PlatformKind
from swarmware.transport.appfile.file import AppFile


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SWARMCTL_LABS", str(tmp_path / "labs"))
    return labs.labs_folder()


def make(folder: Path, name: str, *, living: bool, created: int = 1) -> LabState:
    who = processes.identity(os.getpid())
    nodes = tuple(
        LabNode(
            platform=platform,
            kind=PlatformKind(kind),
            folder=str(folder / name / "n" / platform),
            shm_dir="/dev/shm/x",
            processes="one",
            offset_s=1.5,
            drift_ppm=-3,
            pid=who.pid,
            pid_start=who.start_ticks if living else who.start_ticks - 1,
        )
        for platform, kind in (("ugv1", "ugv"), ("gcs", "gcs"))
    )
    (folder / name).mkdir(parents=True)
    lab = LabState(
        name=name,
        experiment="formation",
        net="loopback",
        seed=1,
        folder=str(folder / name),
        created_utc_ns=created,
        starter=who,
        multicast_group="239.255.1.2",
        udp_port=4000,
        nodes=nodes,
    )
    labs.save(lab)
    return lab


def test_what_is_saved_is_loaded(folder: Path) -> None:
    lab = make(folder, "a", living=True)
    assert labs.load(folder / "a") == lab
    assert lab.station.platform == "gcs"
    assert lab.node("ugv1").config_dir == folder / "a" / "n" / "ugv1" / "etc"


def test_newest_running_lab_is_the_default(folder: Path) -> None:
    make(folder, "old", living=True, created=1)
    make(folder, "new", living=True, created=2)
    make(folder, "dead", living=False, created=3)
    assert labs.find().name == "new"
    assert labs.find("old").name == "old"
    assert [lab.name for lab in labs.labs()] == ["old", "new", "dead"]


def test_absent_lab_error_names_starting_command(folder: Path) -> None:
    make(folder, "dead", living=False)
    with pytest.raises(NotFound, match="lab up"):
        labs.find()


def test_lab_is_named_or_newest_or_by_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SWARM_CONFIG", raising=False)
    assert labs.chosen(CliSettings()) is None
    make(folder, "dead", living=False, created=3)
    assert labs.chosen(CliSettings()) is None
    make(folder, "old", living=True, created=1)
    new = make(folder, "new", living=True, created=2)
    assert labs.chosen(CliSettings()) == new
    assert config_dir(CliSettings()) == new.station.config_dir
    assert [labs.chosen(CliSettings(lab=name)).name for name in ("old", "dead")] == ["old", "dead"]  # type: ignore[union-attr]  # neither is None
    assert labs.chosen(CliSettings(config="/etc/swarm")) is None
    with pytest.raises(NotFound, match="nosuch"):
        labs.chosen(CliSettings(lab="nosuch"))


def test_foreign_modules_are_named_and_left_running(folder: Path) -> None:
    lab = make(folder, "a", living=False)
    module = AppFile(lab.node("ugv1").run_dir, "thermometer", endpoint="ipc://x", started_ns=1)
    stdout, stderr = io.StringIO(), io.StringIO()
    try:
        end_labs("a", Output(CliSettings(output="json"), stdout, stderr), everything=False, keep=False)
    finally:
        module.close()
    left = f"ugv1: thermometer#1 (process {os.getpid()})"
    assert json.loads(stdout.getvalue())["ended"][0]["left"] == [left]
    assert left in stderr.getvalue() and "not ended" in stderr.getvalue()


def test_lab_with_only_radio_is_ended(folder: Path) -> None:
    make(folder, "dead", living=False, created=3)
    left = make(folder, "left", living=False)
    stdout = io.StringIO()
    out = Output(CliSettings(output="json"), stdout, io.StringIO())
    with subprocess.Popen(["sleep", "60"], env={**os.environ, processes.MARK: left.mark}) as radio:
        with pytest.raises(NotFound):
            labs.find()
        end_labs("", out, everything=False, keep=False)
        assert radio.wait(20) != 0
    assert [lab["name"] for lab in json.loads(stdout.getvalue())["ended"]] == ["left"]
    with pytest.raises(NotFound, match="lab up"):
        end_labs("", out, everything=False, keep=False)


def test_unknown_node_is_named_beside_those_there_are(folder: Path) -> None:
    with pytest.raises(NotFound, match=r"uav9.*expected one of ugv1, gcs"):
        make(folder, "a", living=True).node("uav9")


def test_damaged_record_is_error_but_skipped_in_list(folder: Path) -> None:
    make(folder, "a", living=True)
    (folder / "b").mkdir()
    (folder / "b" / "lab.json").write_bytes(b'{"name": 7}')
    with pytest.raises(ConfigError, match=r"lab\.json"):
        labs.load(folder / "b")
    assert [lab.name for lab in labs.labs()] == ["a"]


def test_folder_writable_by_others_is_not_used(folder: Path) -> None:
    folder.chmod(0o777)
    with pytest.raises(Denied, match="only you"):
        labs.labs_folder()


@pytest.mark.parametrize("name", ["", "A", "../x", "a/b", "x" * 25, "1a"])
def test_name_that_would_leave_folder_is_refused(name: str) -> None:
    with pytest.raises(InvalidInput):
        labs.check_name(name)
