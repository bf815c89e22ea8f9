"""A user's module that a signal stops leaves the node as if it had ended by itself."""

import contextlib
import signal
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S

from swarmware.errors import NoAnswer
from swarmware.module.module import Module
from swarmware.testing.leaks import no_leaks
from swarmware.testing.process import run_python, spawn
from swarmware.testing.tmpnode import make_node
from swarmware.transport.appfile.table import scan
from swarmware.types.health import Fault, HealthReport
from swarmware.types.rpc import Empty

SCRIPT = Path(__file__).with_name("script.py")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
async def test_module_ended_by_signal_removes_its_files(tmp_path: Path, number: signal.Signals) -> None:
    config = make_node(tmp_path)
    with no_leaks(tmp_path / "uav1/run", tmp_path / "uav1/shm"):
        async with run_python(str(SCRIPT), str(config)) as script:
            assert await script.line() == "running"
            assert [entry.id for entry in scan(tmp_path / "uav1/run")] == ["thermometer#1"]
            script.signal(number)
            code = await script.wait()
            if number is signal.SIGTERM:
                assert (code, script.stderr()) == (143, "")


TWO_TASKS = """
import asyncio, sys
from swarmware.module.module import Module

with asyncio.Runner() as runner:
    module = Module("thermometer", config_dir=sys.argv[1])
    runner.run(module.__aenter__())
    print("running", flush=True)
    runner.run(asyncio.sleep(1000))
"""


async def test_program_after_its_modules_task_ends_by_sigterm(
    tmp_path: Path,
) -> None:
    config = make_node(tmp_path)
    path = tmp_path / "two_tasks.py"
    path.write_text(TWO_TASKS)
    async with run_python(str(path), str(config)) as script:
        assert await script.line() == "running"
        script.signal(signal.SIGTERM)
        assert await script.wait() in (-signal.SIGTERM, 128 + signal.SIGTERM)


async def test_a_module_ended_by_sigterm_leaves_no_fault(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"health": {"look_hz": 20.0, "grace_s": 0.1}})
    async with Module("probe", config_dir=config) as probe, spawn(config, "health"):
        faults = probe.stream_reader("health/faults", Fault)
        async with run_python(str(SCRIPT), str(config)) as script:
            assert await script.line() == "running"
            while True:
                report = await probe.request("sys/health/state", Empty(), HealthReport, timeout_s=PATIENCE_S)
                if "age/motor/heat" in {check.check for check in report.checks}:
                    break
            assert await script.terminate() == 143
        with contextlib.suppress(NoAnswer):
            while True:  # it would be lost after 3 s; a busy computer may have faults of its own
                assert (await faults.next(timeout_s=3.5)).check != "age/motor/heat"
        report = await probe.request("sys/health/state", Empty(), HealthReport, timeout_s=PATIENCE_S)
        assert "age/motor/heat" not in {check.check for check in report.checks}
