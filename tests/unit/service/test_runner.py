"""The main function of a process of services: ready, ended by a signal, or failed with an exit code."""

import asyncio
import gc
import logging
import os
import resource
import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import ClassVar

import msgspec
import pytest

from swarmware.errors import ConfigError, InvalidInput, NotFound, SwarmError
from swarmware.footprint.entry_points import EntryPoint
from swarmware.service import installed as installed_services
from swarmware.service import runner
from swarmware.service.runner import run_services
from swarmware.service.service import Service
from swarmware.testing.tmpnode import make_node


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Instruction to the probe."""

    does: str = "ends"


class Probe(Service):
    """A service that executes the instruction of a test when it runs."""

    name = "probe"
    Config = Settings
    calls: ClassVar[list[str]] = []
    acts: ClassVar[dict[str, Callable[[], None]]] = {
        "ends": lambda: os.kill(os.getpid(), signal.SIGTERM),
        "is interrupted": lambda: os.kill(os.getpid(), signal.SIGINT),
        "refuses": lambda: _raise(InvalidInput("probe: 3 legs; expected 4")),
        "has a mistake": lambda: _raise(ZeroDivisionError("of the author")),
        "lacks a file": lambda: _raise(PermissionError(13, "Permission denied", "/dev/lidar")),
    }

    async def run(self) -> None:
        Probe.calls.append("run")
        self.acts[self.config.does]()
        await asyncio.Event().wait()

    async def stop(self) -> None:
        Probe.calls.append("stop")


class Second(Probe):
    """Another service of the same process."""

    name = "second"

    async def run(self) -> None:
        await asyncio.Event().wait()


def _raise(error: Exception) -> None:
    raise error


@pytest.fixture(autouse=True)
def _process(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Runs this process as a process of services, and restores it afterwards."""
    values = {"probe": f"{__name__}:Probe", "second": f"{__name__}:Second"}
    points = {name: EntryPoint(name, value, "swarmware.services") for name, value in values.items()}
    monkeypatch.setattr(installed_services, "installed", lambda: points)
    monkeypatch.delenv("JOURNAL_STREAM", raising=False)
    root, limits = logging.getLogger(), resource.getrlimit(resource.RLIMIT_NOFILE)
    handlers, level = root.handlers[:], root.level
    handled = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    Probe.calls.clear()
    yield
    root.handlers[:] = handlers
    root.setLevel(level)
    resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    for number, handler in handled.items():
        signal.signal(number, handler)
    gc.unfreeze()


def node(tmp_path: Path, does: str = "ends") -> Path:
    return make_node(tmp_path, services={"probe": {"does": does}, "second": {}})


@pytest.mark.parametrize("does", ["ends", "is interrupted"])
def test_signal_stops_services_in_order_with_0(tmp_path: Path, does: str) -> None:
    assert run_services(node(tmp_path, does), ["probe", "second"]) == 0
    assert Probe.calls == ["run", "stop", "stop"]
    assert not list((tmp_path / "uav1/shm").glob("app.*.ring")), "nothing of them is left"


@pytest.mark.parametrize(
    ("does", "code", "text"),
    [
        ("refuses", 7, "probe: 3 legs; expected 4"),
        ("lacks a file", 1, "/dev/lidar"),
        ("has a mistake", 1, "ZeroDivisionError"),
    ],
)
def test_failing_lone_service_ends_with_error_code(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], does: str, code: int, text: str
) -> None:
    assert run_services(node(tmp_path, does), ["probe"]) == code
    logged = capfd.readouterr().err
    assert text in logged
    assert ("Traceback" in logged) == (does == "has a mistake"), "a stack only for a mistake of ours"


def test_service_manager_is_notified_of_start_and_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "n"))
        manager.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "n"))
        monkeypatch.setenv("WATCHDOG_USEC", "4000000")
        # it ends when it is ready, not before
        monkeypatch.setattr(runner, "freeze_later", lambda _: os.kill(os.getpid(), signal.SIGTERM))
        monkeypatch.setitem(Probe.acts, "waits", lambda: None)
        assert run_services(node(tmp_path, "waits"), ["probe", "second"]) == 0
        words = [manager.recv(4096).decode().split("\n")[0] for _ in range(3)]
        assert sorted(words) == ["READY=1", "STOPPING=1", "WATCHDOG=1"]
        assert words[0] == "READY=1"


@pytest.mark.parametrize(
    ("names", "prepare", "error", "text"),
    [
        (["prob"], lambda etc: None, NotFound, "did you mean probe"),
        (
            ["probe"],
            lambda etc: (etc / "services/probe.toml").write_text("do = 1"),
            ConfigError,
            "key do",
        ),
        (["probe"], lambda etc: (etc / "node.toml").write_text("platform = 1"), ConfigError, "platform"),
        (["probe"], lambda etc: (etc / "node.toml").unlink(), SwarmError, "node.toml"),
    ],
)
def test_misfit_is_refused_before_anything_runs(
    tmp_path: Path, names: list[str], prepare: Callable[[Path], object], error: type[SwarmError], text: str
) -> None:
    config_dir = node(tmp_path)
    prepare(config_dir)
    with pytest.raises(error, match=text):
        run_services(config_dir, names)
    assert Probe.calls == []


def test_too_low_limit_of_open_files_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    limits: list[tuple[int, int]] = []
    monkeypatch.setattr(resource, "getrlimit", lambda _: (64, 100))
    monkeypatch.setattr(resource, "setrlimit", lambda _, both: limits.append(both))
    with pytest.raises(SwarmError, match="the limit is 100, 2 services in this process need 112"):
        run_services(node(tmp_path), ["probe", "second"])
    assert limits == [(100, 100)]


def test_journal_lines_have_priority_and_whole_stack(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("JOURNAL_STREAM", "8:1")
    assert run_services(node(tmp_path, "has a mistake"), ["probe"]) == 1
    lines = capfd.readouterr().err.splitlines()
    failed = [line for line in lines if "ZeroDivisionError" in line]
    assert failed
    assert all(line.startswith("<3>") for line in failed)
    assert all(line[0] == "<" for line in lines)
