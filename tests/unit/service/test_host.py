"""The services of one process: restarted independently of each other, and stopped in order."""

import asyncio
import logging
from pathlib import Path
from typing import ClassVar

import msgspec
import pytest
from tests import patience
from tests.patience import PATIENCE_S

from swarmware.errors import Conflict, NotFound
from swarmware.model import paths
from swarmware.model.config import load
from swarmware.model.stored_setting import FILE
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.node.node import Node
from swarmware.service import host as host_module
from swarmware.service.host import PreparedService, ServiceEnded, ServiceHost
from swarmware.service.service import NoSettings, Service
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.health import CheckReport, CheckReports
from swarmware.types.scalar import Float, Int
from swarmware.types.system import AppStatus

PAUSES_S = (0.0, 0.001, 0.002)


class Steady(Service):
    """Runs until it is cancelled."""

    name = "steady"
    begun: ClassVar[int] = 0
    ended: ClassVar[list[str]] = []

    async def run(self) -> None:
        type(self).begun += 1
        (self.module.writer("test/begun", Int)).write(Int(type(self).begun))
        await asyncio.Event().wait()

    async def stop(self) -> None:
        Steady.ended.append(self.name)


class Other(Steady):
    name = "other"

    async def run(self) -> None:
        await asyncio.Event().wait()


class Failing(Service):
    """Fails at each start."""

    name = "failing"

    async def run(self) -> None:
        await asyncio.sleep(0)
        raise Conflict("no luck")


class Returning(Service):
    """A service whose `run` returns."""

    name = "returning"

    async def run(self) -> None:
        await asyncio.sleep(0)


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Resets the counters of the probes, and makes the back-off short."""
    monkeypatch.setattr(host_module, "BACKOFF_S", PAUSES_S)
    monkeypatch.setattr(Steady, "begun", 0)
    monkeypatch.setattr(Steady, "ended", [])


def hosted(node: Node, *classes: type[Service]) -> tuple[ServiceHost, "asyncio.Task[None]"]:
    host = ServiceHost(node, [PreparedService(cls, NoSettings()) for cls in classes])
    return host, asyncio.create_task(host.run())


async def over(running: "asyncio.Task[None]") -> None:
    running.cancel()
    await asyncio.wait([running])


async def until(board: BoardReader[AppStatus], restarts: int) -> AppStatus:
    async with asyncio.timeout(PATIENCE_S):
        while (now := board.value) is None or (now.restarts, now.state) < (restarts, "running"):
            await board.changed()
    return now


def pauses(caplog: pytest.LogCaptureFixture) -> list[object]:
    return [r.args[1] for r in caplog.records if isinstance(r.args, tuple) and "starts again" in r.msg]


async def test_failing_service_waits_longer_and_disturbs_none(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG, "swarm.host")
    async with tmp_node(tmp_path) as node, Module("probe", node=node) as probe:
        host, running = hosted(node, Steady, Failing)
        status = probe.reader("app/failing/status", AppStatus)
        await host.started()

        await patience.until(lambda: len(pauses(caplog)) >= 4)
        assert pauses(caplog)[:4] == [*PAUSES_S, PAUSES_S[-1]]
        assert [r for r in caplog.records if "no luck" in r.getMessage()]
        assert Steady.begun == 1
        now = await until(status, 1)
        assert now.failures == now.restarts
        await over(running)


@pytest.mark.parametrize(("cls", "raised"), [(Failing, Conflict), (Returning, ServiceEnded)])
async def test_lone_service_ends_process_by_its_outcome(
    tmp_path: Path, cls: type[Service], raised: type[Exception]
) -> None:
    async with tmp_node(tmp_path) as node:
        _, running = hosted(node, cls)
        with pytest.raises(ExceptionGroup) as caught:
            await running
        assert caught.group_contains(raised)


@pytest.mark.parametrize("others", [(), (Other,)])
async def test_requested_restart_is_no_failure_and_keeps_boards(
    tmp_path: Path, others: tuple[type[Service], ...], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG, "swarm.host")
    async with tmp_node(tmp_path) as node, Module("probe", node=node) as probe:
        host, running = hosted(node, Steady, *others)
        await host.started()
        begun = probe.reader("test/begun", Int)
        status = probe.reader("app/steady/status", AppStatus)
        assert begun.value == Int(1)
        host.restart("steady")
        while Steady.begun < 2:
            assert begun.value is not None, "readable while the service comes back"
            await asyncio.sleep(0)
        assert (await until(status, 1)).restarts == 1
        for number in range(2, len(PAUSES_S) + 3):
            host.restart("steady")
            assert (await until(status, number)).failures == 0
        assert set(pauses(caplog)) == {0.0}, "at once, however often"
        with pytest.raises(NotFound, match="'nosuch': not in this process; expected one of steady"):
            host.restart("nosuch")
        await over(running)


class Tuned(Service):
    """Reports the gain that it starts with."""

    class Gains(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        gain: float = 1.0

    name = "tuned"
    Config = Gains
    live_settings: ClassVar = {"gain": "tuned/gain"}

    async def run(self) -> None:
        self.module.writer("test/gain", Float).write(Float(self.config.gain))
        await asyncio.Event().wait()


async def test_restarted_service_rereads_file_and_keeps_overrides(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with tmp_node(tmp_path, services={"tuned": {"gain": 1.5}}) as node, Module("m", node=node) as m:
        file = paths.service_config(node.config_dir, "tuned")
        gain = m.reader("test/gain", Float)
        prepared = PreparedService(Tuned, load(file, Tuned.Gains), node.config_dir)
        host = ServiceHost(node, [prepared, PreparedService(Other, NoSettings())])
        running = asyncio.create_task(host.run())
        await host.started()
        assert await gain.changed(10) == Float(1.5)

        async def restarted() -> float:
            host.restart("tuned")
            return (await gain.changed(10)).value

        file.write_text("gain = 2.5")
        assert await restarted() == 2.5
        stored = node.config.data_path / FILE
        stored.parent.mkdir()
        stored.write_text('["config/tuned/gain"]\nvalue = 4.0\nversion = 1\n')
        file.write_text("gain = 3.5")
        assert await restarted() == 4.0, "the override stays"
        node.table.refresh()
        entry = node.table.named("tuned")
        assert entry is not None
        assert entry.config == {"gain": 3.5}, "the value of the file, for when the override is removed"
        stored.unlink()
        file.write_text("gian = 5.5")
        assert await restarted() == 3.5
        assert "tuned: starts with its former configuration" in caplog.text
        assert "did you mean gain?" in caplog.text
        await over(running)


class Stubborn(Steady):
    """Does not finish in time."""

    name = "stubborn"
    stop_s = 0.01

    async def run(self) -> None:
        await asyncio.Event().wait()

    async def stop(self) -> None:
        await asyncio.Event().wait()


class Clumsy(Other):
    """Fails as it stops."""

    name = "clumsy"

    async def stop(self) -> None:
        raise ZeroDivisionError("as it stops")


class Unbuilt(Other):
    """A service whose constructor fails at first."""

    name = "unbuilt"
    left: ClassVar[int] = 2

    def __init__(self, module: Module, config: NoSettings) -> None:
        super().__init__(module, config)
        module.writer("test/early", Int).write(Int(Unbuilt.left))
        if Unbuilt.left:
            Unbuilt.left -= 1
            raise Conflict("not yet")


async def test_service_failing_to_stop_holds_no_other(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with tmp_node(tmp_path) as node:
        host, running = hosted(node, Steady, Stubborn, Clumsy)
        assert (host.names, host.stop_s) == (["steady", "stubborn", "clumsy"], Steady.stop_s)
        await host.started()
        await host.stop()
        assert Steady.ended == ["steady"], "asked to stop although two others failed"
        assert "stubborn: did not finish within 0.01 s" in caplog.text
        assert "clumsy: failed while stopping" in caplog.text
        await over(running)


async def test_unconstructible_service_is_restarted_and_keeps_boards(
    tmp_path: Path,
) -> None:
    async with tmp_node(tmp_path) as node, Module("probe", node=node) as probe:
        _, running = hosted(node, Steady, Unbuilt)
        status, early = probe.reader("app/unbuilt/status", AppStatus), probe.reader("test/early", Int)
        assert (await until(status, 2)).state == "running"
        assert early.value == Int(0)
        assert early.sequence == 3, "one board over three starts"
        await over(running)


async def test_services_end_in_reverse_order_and_announce(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("probe", node=node) as probe:
        host, running = hosted(node, Steady, Other)
        await host.started()
        status = probe.reader("app/steady/status", AppStatus)
        await host.stop()
        assert Steady.ended == ["other", "steady"]
        assert status.value is not None
        assert status.value.state == "stopping"
        await over(running)
        assert not (node.shm_dir / "test.begun.ring").exists(), "an orderly end leaves no board"


@pytest.mark.parametrize("others", [(), (Other,)])
async def test_halted_service_leaves_node_and_runs_on_release(
    tmp_path: Path, others: tuple[type[Service], ...]
) -> None:
    async with tmp_node(tmp_path) as node:
        host, running = hosted(node, Steady, *others)
        await host.started()
        ended = asyncio.Event()
        host.halt("steady", ended.set)
        host.halt("steady", ended.set)
        async with asyncio.timeout(PATIENCE_S):
            await ended.wait()
        assert host.halted("steady")
        node.table.refresh(probe=True)
        assert "steady" not in {entry.name for entry in node.table}
        assert not running.done(), "the process and its other services run on"
        assert Steady.begun == 1
        host.release("steady")
        host.release("steady")
        async with asyncio.timeout(PATIENCE_S):
            while Steady.begun < 2:  # noqa: ASYNC110 - the service itself has no event
                await asyncio.sleep(0)
        assert not host.halted("steady")
        await over(running)


async def test_orphaned_services_continue_and_one_has_fault(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with tmp_node(tmp_path) as node, Module("t", node=node) as m:
        host, running = hosted(node, Steady, Other)
        await host.started()
        reports = m.reader("health/checks/steady", CheckReports)

        async def until_state(state: str) -> CheckReport:
            async with asyncio.timeout(PATIENCE_S):
                while (now := reports.value) is None or now.reports[0].state != state:
                    await reports.changed()
            return now.reports[0]

        host.on_supervised(True)
        for supervised in (False, False):
            host.on_supervised(supervised)
        found = await until_state("missing")
        assert (found.check, found.level) == ("steady/supervisor", "warn")
        host.restart("steady")
        while Steady.begun < 2:  # noqa: ASYNC110 - the service itself has no event
            await asyncio.sleep(0)
        assert (await until_state("missing")).level == "warn", "the restarted service says so, too"
        host.on_supervised(True)
        assert (await until_state("ok")).level == "ok"
        assert caplog.text.count("start the node again") == 1
        await over(running)


class Hal(Steady):
    name = "hal"


@pytest.mark.parametrize(("required", "level"), [(False, "warn"), (True, "error")])
async def test_service_without_real_time_runs_with_fault(tmp_path: Path, required: bool, level: str) -> None:
    realtime = {"services": {"hal": 50}, "required": required}
    async with (
        tmp_node(tmp_path, services={"hal": {}}, realtime=realtime) as node,
        Module("t", node=node) as m,
    ):
        host = ServiceHost(node, [PreparedService(Hal, NoSettings()), PreparedService(Other, NoSettings())])
        task = asyncio.create_task(host.run())
        reports = await m.reader("health/checks/hal", CheckReports).changed(20.0)
        (found,) = reports.reports
        assert (found.check, found.state, found.level) == ("hal/realtime", "refused", level)
        task.cancel()
        await asyncio.wait([task])
