"""The runner of services: ready, restarted inside, stopped in order, wrong configuration named."""

import asyncio
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.patience import PATIENCE_S

from swarmware.errors import SwarmError
from swarmware.model.config import load_node
from swarmware.module.module import Module
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import run_python, spawn
from swarmware.testing.tmpnode import make_node
from swarmware.transport.appfile.table import scan
from swarmware.types.health import FaultList, FaultQuery, GuardStatus, HealthReport
from swarmware.types.rpc import Empty
from swarmware.types.scalar import Int, Text
from swarmware.types.system import AppStatus

HERE = Path(__file__).parent


def install(folder: Path) -> dict[str, str]:
    """Environment of a process that finds the services beside this file by their entry points."""
    info = folder / "testservices-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: testservices\nVersion: 1.0\n")
    points = [f"{name.lower()} = services:{name}" for name in ("Steady", "Fragile", "Stubborn")]
    points.append("temp-sensor = services:TempSensor")
    points.append("misnamed = services:Steady")
    (info / "entry_points.txt").write_text("\n".join(["[swarmware.services]", *points]))
    return {"PYTHONPATH": f"{folder}:{HERE}"}


class Setting(NamedTuple):
    config_dir: Path
    env: dict[str, str]


@pytest.fixture
def setting(tmp_path: Path) -> Iterator[Setting]:
    config_dir = make_node(tmp_path)
    load_node(config_dir).data_path.mkdir()
    packages = tmp_path / "etc"  # configuration: may stay
    packages.mkdir()
    with no_leaks(tmp_path / "uav1" / "run", tmp_path / "uav1" / "shm"):
        yield Setting(config_dir, install(packages))


def test_service_runs_with_settings_and_stops_in_order(setting: Setting) -> None:
    config_dir, env = setting

    async def run() -> None:
        (config_dir / "services" / "steady.toml").write_text("start = 1000\n")
        async with Module("test", config_dir=config_dir) as m:
            count = m.reader("test/count", Int)
            async with spawn(config_dir, "steady", env=env) as process:
                assert (await count.changed(PATIENCE_S)).value > 1000
                beats = m.reader("app/steady/status", AppStatus)
                assert beats.value is not None
                assert beats.value.state == "running", "a node that is ready says so at once"
                status = await beats.changed(PATIENCE_S)
                assert (status.pid, status.restarts) == (process.pid, 0)
                (entry,) = [entry for entry in scan(load_node(config_dir).run_path) if entry.name == "steady"]
                assert entry.config == {"start": 1000}
                assert {"test/count", "app/steady/status"} <= {item.path for item in entry.provides}
                assert await process.terminate() == 0
            assert (load_node(config_dir).data_path / "stopped").read_text() == "orderly"

    asyncio.run(run())


def test_service_and_module_with_hyphens_run_under_guard(setting: Setting) -> None:
    config_dir, env = setting

    async def run() -> None:
        node = (config_dir / "node.toml").read_text()
        services = '["temp-sensor", "guard", "health"]'
        (config_dir / "node.toml").write_text(re.sub(r"services = \[[^]]*\]", f"services = {services}", node))
        (config_dir / "services" / "temp-sensor.toml").write_text("start = 21\n")
        async with Module("my-module", config_dir=config_dir) as m:
            watched = m.reader("guard/status", GuardStatus)
            beats = m.reader("app/temp_sensor/status", AppStatus)
            temperature = m.reader("sensor/temperature", Int)
            async with spawn(config_dir, env=env), asyncio.timeout(PATIENCE_S):
                while temperature.value is None:
                    await temperature.changed()
                assert temperature.value == Int(21)
                assert await m.send("sensor/offset", Int(22), timeout_s=PATIENCE_S)
                assert await temperature.changed() == Int(22)
                while beats.value is None or beats.value.state != "running":
                    await beats.changed()
                while watched.value is None or not any(
                    (one.name, one.state) == ("temp-sensor", "running") for one in watched.value.services
                ):
                    await watched.changed()
                report = await m.request("sys/health/state", Empty(), HealthReport, timeout_s=PATIENCE_S)
                assert "age/sensor/temperature" in {check.check for check in report.checks}
                found = await m.request("sys/health/faults", FaultQuery(), FaultList, timeout_s=PATIENCE_S)
                assert not [fault.check for fault in found.faults if fault.check.startswith("app/")]
                names = {entry.id for entry in scan(load_node(config_dir).run_path)}
                assert {"temp-sensor#1", "my-module#1"} <= names

    asyncio.run(run())


def test_entry_point_of_another_name_is_mistake(setting: Setting) -> None:
    config_dir, env = setting

    async def run() -> None:
        with pytest.raises(SwarmError, match=r"ended with 7[^$]*is named 'steady'"):
            async with spawn(config_dir, "misnamed", env=env):
                pass

    asyncio.run(run())


def test_failing_service_restarts_and_neighbours_notice_nothing(setting: Setting) -> None:
    config_dir, env = setting

    async def run() -> None:
        async with (
            Module("test", config_dir=config_dir) as m,
            spawn(config_dir, "steady", "fragile", env=env) as process,
        ):
            count = m.reader("test/count", Int)
            board = m.reader("test/fragile", Text)
            status = m.reader("app/fragile/status", AppStatus)
            life = await board.changed(PATIENCE_S)
            for restarts, order in enumerate(("boom", "return", "boom"), 1):
                before = (await count.changed(PATIENCE_S)).value
                assert await m.send("test/order", Text(order), timeout_s=PATIENCE_S)
                while (again := await board.changed(PATIENCE_S)) == life:
                    pass
                life = again
                while (await status.changed(PATIENCE_S)).restarts < restarts:
                    assert board.value is not None
                assert (await count.changed(PATIENCE_S)).value > before
                pid = await m.request("test/pid", Int(0), Int, timeout_s=PATIENCE_S)
                assert pid.value == process.pid, "in the same process"
            said = process.stderr()
            assert "fragile: failed: boom" in said
            assert "run() returned" in said
            assert "starts again in" in said

    asyncio.run(run())


def test_node_names_services_that_are_not_ready(setting: Setting) -> None:
    config_dir, env = setting

    async def run() -> None:
        with socket.create_server(("127.0.0.1", 0)) as other:
            port = other.getsockname()[1]
            (config_dir / "services" / "broker.toml").write_text(f"tcp_port = {port}\n")
            await without_broker(port)

    async def without_broker(port: int) -> None:
        async with (
            Module("test", config_dir=config_dir) as m,
            spawn(config_dir, "steady", "broker", env=env) as process,
        ):
            count = m.reader("test/count", Int)
            async with asyncio.timeout(PATIENCE_S):
                while "not ready: broker" not in process.stderr():
                    await count.changed()
            said = process.stderr()
            assert f"broker: failed: broker: bind_address 127.0.0.1, tcp_port {port}" in said
            assert "ready: steady\n" in said

    asyncio.run(run())


def test_service_alone_ends_its_process_when_it_fails(setting: Setting) -> None:
    config_dir, env = setting

    async def run() -> None:
        async with (
            Module("test", config_dir=config_dir) as m,
            spawn(config_dir, "fragile", env=env) as process,
        ):
            outcome = await m.send("test/order", Text("boom"), timeout_s=PATIENCE_S)
            assert outcome, process.stderr()
            assert await process.wait() == 1
            assert "ValueError: boom" in process.stderr()

    asyncio.run(run())


def test_step_that_holds_event_loop_is_named(setting: Setting) -> None:
    config_dir, env = setting

    async def run() -> None:
        async with (
            Module("test", config_dir=config_dir) as m,
            spawn(config_dir, "steady", env=env) as process,
        ):
            status = m.reader("app/steady/status", AppStatus)
            await m.request("test/block", Int(150), Int, timeout_s=PATIENCE_S)
            while (await status.changed(PATIENCE_S)).loop_lag_ms < 100:
                pass
            held_ms = re.findall(r"serve test/block held the event loop for (\d+) ms", process.stderr())
            assert len(held_ms) == 1
            assert int(held_ms[0]) >= 150

    asyncio.run(run())


def test_unfinishing_service_is_not_waited_for(setting: Setting) -> None:
    config_dir, env = setting

    async def run() -> None:
        async with spawn(config_dir, "stubborn", "steady", env=env) as process:
            process.signal(signal.SIGINT)
            assert await process.wait(PATIENCE_S) == 0
            assert "stubborn: did not finish" in process.stderr()
        assert (load_node(config_dir).data_path / "stopped").exists()

    asyncio.run(run())


@pytest.mark.parametrize(
    ("names", "files", "code", "words"),
    [
        (["stedy"], {}, 6, "did you mean steady?"),
        (["steady"], {"services/steady.toml": "start = -1"}, 7, "steady.toml: line 1: key start: expected"),
        (["steady"], {"services/steady.toml": "strat = 1"}, 7, "did you mean start?"),
        (["steady"], {"node.toml": "platform = "}, 7, "node.toml: line 1: invalid TOML"),
        ([], {"node.toml": 'processes = "per-daemon"\nservices = ["steady"]'}, 7, "needs the guard"),
    ],
)
def test_failed_start_is_one_line_and_exit_code(
    setting: Setting, names: list[str], files: dict[str, str], code: int, words: str
) -> None:
    config_dir, env = setting
    for name, text in files.items():
        (config_dir / name).write_text(text)

    async def run() -> None:
        with pytest.raises(SwarmError) as caught:
            async with spawn(config_dir, *names, env=env):
                pass
        message = str(caught.value)
        assert f"ended with {code} " in message
        assert words in message
        assert "Traceback" not in message

    asyncio.run(run())


def test_low_limit_of_open_files_is_named(
    tmp_path: Path,
) -> None:
    config = make_node(tmp_path, services={"timesync": {}})
    done = subprocess.run(
        ["bash", "-c", f"ulimit -n 64; exec {sys.executable} -m swarmd run timesync --config {config}"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1, done.stderr
    assert "open files: the limit is 64, 1 services in this process need 88" in done.stderr


def resident_pages(pid: int) -> int:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1])


async def test_parent_of_node_is_little_more_than_interpreter(tmp_path: Path) -> None:
    config_dir = make_node(tmp_path, services={"timesync": {}})
    bare = "import signal, socket; print(flush=True); signal.pause()"
    async with run_python("-c", bare) as interpreter, spawn(config_dir) as parent:
        await interpreter.line()
        assert resident_pages(parent.pid) < 1.25 * resident_pages(interpreter.pid)
