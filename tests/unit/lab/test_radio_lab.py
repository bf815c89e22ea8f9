"""A lab with a radio before its first process: addresses, options, rights, leftovers."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import msgspec
import pytest

from swarmctl.session import labs, processes
from swarmlab.experiment import run_command
from swarmlab.provision import provisioning
from swarmlab.provision.database import address_for_nodes
from swarmlab.provision.provisioning import LabSpec
from swarmlab.radio import namespace
from swarmlab.radio.namespace import check_rights
from swarmlab.run import running
from swarmware.errors import Denied, InvalidInput, NotFound

SPEC = LabSpec(experiment="formation", nodes=3, seed=1, net="netns")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SWARMCTL_LABS", str(tmp_path / "labs"))
    return labs.labs_folder()


@pytest.fixture
def rights(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(provisioning, "check_rights", lambda: True)


def test_each_node_gets_own_address_and_namespace(rights: None) -> None:
    lab = provisioning.make(SPEC)
    try:
        assert [node.address for node in lab.nodes] == ["10.83.0.1", "10.83.0.2", "10.83.0.3"]
        assert Path(lab.radio_file).name == "s3.toml"
        for node in lab.nodes:
            broker = tomllib.loads((node.config_dir / "services/broker.toml").read_text())
            assert broker["bind_address"] == broker["multicast_interface"] == node.address
            assert running.command(node)[:4] == [
                *("nsenter", "--preserve-credentials", f"--net={node.namespace}", sys.executable)
            ]
            assert Path(node.namespace).parent == Path(node.folder)
    finally:
        provisioning.remove(lab)


def test_loggers_behind_radio_reach_database_by_socket(rights: None) -> None:
    lab = provisioning.make(msgspec.structs.replace(SPEC, mongodb_uri="mongodb://127.0.0.1:27018"))
    try:
        assert lab.mongodb_uri == "mongodb://127.0.0.1:27018", "commands of the operator need no socket"
        for node in lab.nodes:
            logger = tomllib.loads((node.config_dir / "services/logger.toml").read_text())
            assert logger["mongodb_uri"] == address_for_nodes(lab.mongodb_uri, Path(lab.folder))
            assert logger["mongodb_database"] == lab.mongodb_database
    finally:
        provisioning.remove(lab)


def test_on_loopback_nodes_have_neither(rights: None) -> None:
    lab = provisioning.make(msgspec.structs.replace(SPEC, net="loopback"))
    try:
        assert {node.address for node in lab.nodes} == {"127.0.0.1"}
        assert lab.radio_file == ""
        assert running.command(lab.nodes[0])[0] == sys.executable
    finally:
        provisioning.remove(lab)


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"net": "loopback", "radio": "s3"}, InvalidInput, "--net loopback has no radio"),
        ({"radio": "s9"}, NotFound, "expected one of lan, s3"),
        ({"mongodb_uri": "mongodb+srv://db.example.org"}, InvalidInput, "needs several connections"),
        ({"net": "relay"}, InvalidInput, "expected one of loopback, netns"),
    ],
)
def test_contradicting_options_are_refused_first(
    rights: None, folder: Path, changes: dict[str, str], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        provisioning.make(msgspec.structs.replace(SPEC, **changes))
    assert list(folder.iterdir()) == []


def test_missing_namespace_prerequisite_is_named_with_remedy(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(namespace, "_TUN", str(tmp_path / "tun"))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(
        Denied, match=r"nsenter \(.*\), unshare \(.*\), .*tun cannot be used; expected them"
    ) as caught:
        provisioning.make(SPEC)
    assert caught.value.exit_code == 5
    assert list(folder.iterdir()) == []


def test_lab_without_capabilities_and_namespaces_is_denied(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(namespace, "_CAPABILITIES", {"CAP_OF_TOMORROW": 63})
    monkeypatch.setattr(namespace, "_TUN", "/dev/null")
    monkeypatch.setattr(namespace, "_PROBE", ("false",))
    with pytest.raises(Denied, match="lacks CAP_OF_TOMORROW, and the kernel gives it no user namespace"):
        provisioning.make(SPEC)
    assert list(folder.iterdir()) == []


def test_nodes_without_capabilities_enter_user_namespace(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(namespace, "_CAPABILITIES", {"CAP_OF_TOMORROW": 63})
    monkeypatch.setattr(namespace, "_TUN", "/dev/null")
    monkeypatch.setattr(namespace, "_PROBE", ("true",))
    lab = provisioning.make(SPEC)
    try:
        for node in lab.nodes:
            assert f"--user={node.user_namespace}" in running.command(node)
            assert Path(node.user_namespace).parent == Path(node.folder)
    finally:
        provisioning.remove(lab)


def test_the_command_of_a_run_names_the_radio() -> None:
    spec = msgspec.structs.replace(SPEC, radio="lan")
    assert "--net netns --seed 1 --radio lan" in run_command(spec, 60, Path("out"))


def test_radio_of_dead_lab_ends_at_reuse(rights: None, folder: Path) -> None:
    spec = msgspec.structs.replace(SPEC, name="dead")
    dead = provisioning.make(spec)
    gone = processes.ProcessIdentity(1, 1)
    nodes = tuple(msgspec.structs.replace(node, pid=1, pid_start=1) for node in dead.nodes)
    labs.save(msgspec.structs.replace(dead, starter=gone, nodes=nodes))
    left = subprocess.Popen(
        [sys.executable, "-c", "import signal; print(flush=True); signal.pause()"],
        stdout=subprocess.PIPE,
        env={**os.environ, processes.MARK: dead.mark},
    )
    assert left.stdout is not None
    with left.stdout as ready:
        ready.readline()
        again = provisioning.make(spec)
        assert left.wait(10) == -15
    provisioning.remove(again)


def test_full_capabilities_of_process_are_sufficient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(namespace, "_CAPABILITIES", {})
    monkeypatch.setattr(namespace, "_TUN", "/dev/null")
    assert check_rights()
