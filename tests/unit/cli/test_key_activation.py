"""New keys of a running node: its broker is restarted, an armed vehicle is left alone."""

import io
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.unit.cli.session import ScriptedSession

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.keys.making import make_root
from swarmctl.membership import activation, node_keys
from swarmctl.membership.activation import ActivatedKeys, activate, show_activation
from swarmctl.membership.node_keys import NodeKeys
from swarmctl.terminal.output import Output
from swarmware.errors import ConfigError, NoAnswer
from swarmware.testing.tmpnode import make_node
from swarmware.types.net import Routes, RouteState

ROUTES = "/gcs/sys/broker/routes"
WAY = RouteState("uav1", 1, "uav1", 256, 1, 1, 0)


class RunningNode:
    """A node that runs, with what its broker answers; keeps which services were restarted."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.node = NodeKeys.find(CliSettings(config=str(make_node(folder, "gcs"))))
        self.answers: dict[str, Any] = {ROUTES: Routes((WAY,))}
        self.restarted: list[str] = []
        self.armed = False
        self.error: NoAnswer | None = None
        monkeypatch.setattr(NodeKeys, "runs", True)
        monkeypatch.setattr(activation, "connect", self._connect)
        monkeypatch.setattr(activation, "is_armed", self._is_armed)
        monkeypatch.setattr(activation, "restart_one", self._restart)

    @asynccontextmanager
    async def _connect(self, settings: CliSettings, out: Output) -> AsyncIterator[ScriptedSession]:
        assert settings.config == str(self.node.config_dir)
        yield ScriptedSession(self.answers)

    async def _is_armed(self, _session: object) -> bool:
        return self.armed

    async def _restart(self, _session: object, platform: str, name: str, _wait_s: float) -> None:
        if self.error is not None:
            raise self.error
        self.restarted.append(f"{platform}/{name}")

    def activate(self, *, others: bool) -> ActivatedKeys:
        return activate(Output(CliSettings()), self.node, others=others)


@pytest.fixture
def running(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunningNode:
    return RunningNode(tmp_path, monkeypatch)


def said(found: ActivatedKeys, *, running: bool, others: bool) -> str:
    stderr = io.StringIO()
    show_activation(
        Output(CliSettings(), io.StringIO(), stderr), "gcs", found, running=running, others=others
    )
    return stderr.getvalue()


def test_broker_of_running_node_restarts_with_keys(running: RunningNode) -> None:
    found = running.activate(others=False)
    assert running.restarted == ["gcs/broker"]
    assert said(found, running=True, others=False) == "gcs uses these keys now\n"


def test_a_join_ends_when_another_member_is_reached(running: RunningNode) -> None:
    found = running.activate(others=True)
    assert found.reached == ("uav1",)
    assert said(found, running=True, others=True) == "gcs uses these keys now, and reaches uav1\n"


@pytest.mark.parametrize(
    "answer", [Routes(), Routes((RouteState("0000beef", 1, "0000beef", 256, 1, 0, 0),)), NoAnswer("broker")]
)
def test_absent_member_makes_next_step_be_named(
    running: RunningNode, monkeypatch: pytest.MonkeyPatch, answer: Any
) -> None:
    monkeypatch.setattr(activation, "REACH_S", 0.05)
    monkeypatch.setattr(activation, "POLL_S", 0.01)
    running.answers[ROUTES] = answer
    found = running.activate(others=True)
    assert (found.in_use, found.reached) == (True, ())
    text = said(found, running=True, others=True)
    assert text.startswith("warning: ") and "seeds" in text and "swarmctl doctor" in text


def test_an_armed_vehicle_is_not_interrupted(running: RunningNode) -> None:
    running.armed = True
    found = running.activate(others=True)
    assert running.restarted == []
    text = said(found, running=True, others=True)
    assert "gcs is armed" in text and "after a restart" in text and "systemctl restart" in text


def test_restart_that_fails_leaves_keys_and_names_reason(running: RunningNode) -> None:
    running.error = NoAnswer("sys/guard/status: no answer")
    found = running.activate(others=False)
    assert not found.in_use
    assert "sys/guard/status: no answer" in said(found, running=True, others=False)


def test_node_that_does_not_run_is_not_asked(running: RunningNode, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NodeKeys, "runs", False)
    found = running.activate(others=True)
    assert running.restarted == []
    assert said(found, running=False, others=True).startswith("start gcs: systemctl start swarm.target")


def test_computer_without_daemon_user_gets_no_swarm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config_dir = make_node(tmp_path, "gcs")
    monkeypatch.setattr(node_keys, "DEFAULT_DIR", tmp_path)
    monkeypatch.setattr(node_keys, "SERVICE_USER", "nobody_has_this_name")
    monkeypatch.setattr("os.geteuid", lambda: 0)
    with pytest.raises(ConfigError, match="'nobody_has_this_name': not known here"):
        make_root(Output(CliSettings(config=str(config_dir))), tmp_path / "root", "harbour")
    assert not (tmp_path / "root" / "root.key").exists()
    assert not NodeKeys.find(CliSettings(config=str(config_dir))).has_identity
