"""Time synchronisation as a real process: differences in from a stream, functions out on a board."""

import asyncio
import contextlib
from pathlib import Path

import msgspec
import pytest
from tests.patience import PATIENCE_S

from swarmd.timesync import config as settings
from swarmd.timesync.service import TimeSync
from swarmware.errors import NoAnswer, NotFound
from swarmware.model.clock import Clock, utc_ns
from swarmware.model.frame import Frame, FrameKind
from swarmware.model.names import hardware_id
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.transport.delivery.answer import reply
from swarmware.types import registry
from swarmware.types.health import OK_STATE, Fault, HealthReport, Phase
from swarmware.types.rpc import Empty, Reply
from swarmware.types.time import Conversion, TimeFunctions, TimingBatch, TimingSample

DELAY_NS = 100_000


class Remote:
    """Another unit's clock, and the differences that our broker would read off its datagrams."""

    def __init__(self, module: Module, offset_s: float, drift_ppm: float) -> None:
        self.clock = Clock(offset_s, drift_ppm)
        self._module = module
        self._boot_id = 1

    def restart(self, offset_s: float) -> None:
        """Another boot: another clock."""
        self.clock = Clock(offset_s)
        self._boot_id += 1

    def sample(self) -> TimingSample:
        """Sent, echoed and received just now, each way in the same time."""
        received_ns = self._module.now_ns()
        mono_ns = self._module.clock.to_mono_ns(received_ns)
        theirs_ns = self.clock.from_mono_ns(mono_ns)
        offset_ns = theirs_ns - received_ns
        return TimingSample(
            "uav2",
            "main",
            hardware_id("uav2"),
            self._boot_id,
            received_ns,
            offset_ns - DELAY_NS,
            received_ns,
            offset_ns + DELAY_NS,
        )

    def error_ns(self, function: Conversion) -> int:
        """True error of a function at this moment."""
        local_ns = self._module.now_ns()
        true_ns = self.clock.from_mono_ns(self._module.clock.to_mono_ns(local_ns))
        return abs(function.to_remote(local_ns) - true_ns)


async def function_where(
    board: BoardReader[TimeFunctions], stream: BoardWriter[TimingBatch], remote: Remote, wanted: object
) -> Conversion:
    """Feeds samples until the board holds a function of which `wanted` is true."""
    assert callable(wanted)
    async with asyncio.timeout(PATIENCE_S):
        while True:
            stream.write(TimingBatch((remote.sample(),)))
            with contextlib.suppress(NoAnswer):
                await board.changed(timeout_s=0.05)
            function = board.value.of("uav2") if board.value is not None else None
            if function is not None and wanted(function):
                return function


async def test_functions_follow_clock_over_step_and_restart(tmp_path: Path) -> None:
    config = make_node(
        tmp_path, services={"timesync": {"solve_s": 0.1, "publish_s": 0.1}}, clock={"offset_s": -3.0}
    )
    async with Module("broker", config_dir=config) as module:
        stream = module.stream_writer("net/timing", TimingBatch)
        board = module.reader("time/functions", TimeFunctions)
        remote = Remote(module, 4.0, 30.0)
        async with spawn(config, "timesync"):
            first = await function_where(board, stream, remote, lambda function: True)
            assert remote.error_ns(first) <= first.bound_at_ns(module.now_ns())
            known = await function_where(board, stream, remote, lambda function: function.samples >= 8)
            assert remote.error_ns(known) <= known.bound_at_ns(module.now_ns()) < 1_000_000
            asked = await module.request("sys/time/functions", Empty(), TimeFunctions, timeout_s=PATIENCE_S)
            assert asked.of("uav2") is not None

            remote.clock = Clock(9.0, 30.0)
            stepped = await function_where(
                board, stream, remote, lambda function: function.conv_epoch != known.conv_epoch
            )
            assert stepped.conv_epoch == known.conv_epoch + 1
            assert remote.error_ns(stepped) <= stepped.bound_at_ns(module.now_ns())

            remote.restart(-50.0)
            again = await function_where(board, stream, remote, lambda function: function.boot_id == 2)
            assert remote.error_ns(again) <= again.bound_at_ns(module.now_ns())
            stamp_ns = remote.clock.now_ns()
            local_ns = module.remote_clocks.to_local(hardware_id("uav2"), stamp_ns)
            assert local_ns is not None
            assert abs(local_ns - module.now_ns()) < 100_000_000


async def test_killed_service_has_functions_again_from_next_packets(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"timesync": {}})
    async with Module("broker", config_dir=config) as module:
        stream = module.stream_writer("net/timing", TimingBatch)
        board = module.reader("time/functions", TimeFunctions)
        remote = Remote(module, -2.0, -20.0)
        async with spawn(config, "timesync") as process:
            before = await function_where(board, stream, remote, lambda function: True)
            await process.kill()
        assert board.value is not None
        assert board.value.of("uav2") is not None
        async with spawn(config, "timesync"):
            after = await function_where(
                board, stream, remote, lambda function: function.t0_ns > before.t0_ns
            )
            assert remote.error_ns(after) <= after.bound_at_ns(module.now_ns())


class Partner:
    """The other platform's answers to requests that leave through the broker of this test."""

    def __init__(self, module: Module, remote: Remote) -> None:
        self.asked = 0
        self._module = module
        self._remote = remote
        module.node.messaging.set_gateway(self._on_frame)

    def _on_frame(self, frame: Frame) -> None:
        if frame.kind is not FrameKind.REQUEST:
            return
        self.asked += 1
        now_ns = self._remote.clock.now_ns()
        offset_ns = -self._remote.sample().lower_ns - DELAY_NS
        node = self._module.node
        ours = Conversion(
            "uav1", "main", node.hardware, node.clock.boot_id, offset_ns, 0.0, now_ns, 90_000, 5_000, 1e-6, 0,
            samples=50,
        )  # fmt: skip
        broken = msgspec.structs.replace(ours, platform="uav9", hardware=9, skew=5e-3)
        told = TimeFunctions("uav2", "main", 1, now_ns, (ours, broken))
        payload = registry.encode(Reply(True, registry.encode(told)))
        node.messaging.deliver(reply(frame, FrameKind.REPLY, payload, self._module.now_ns()))


async def test_partner_gives_first_value_of_unmeasured_clock(tmp_path: Path) -> None:
    config = make_node(tmp_path, services={"timesync": {}})
    async with Module("broker", config_dir=config) as module:
        stream = module.stream_writer("net/timing", TimingBatch)
        board = module.reader("time/functions", TimeFunctions)
        remote = Remote(module, 4.0, 0.0)
        partner = Partner(module, remote)
        async with spawn(config, "timesync") as process:
            # heard, but nothing of ours was echoed: no round trip to measure
            deaf = msgspec.structs.replace(remote.sample(), sent_ns=0, upper_ns=None)
            async with asyncio.timeout(PATIENCE_S):
                while (function := board.value.of("uav2") if board.value else None) is None:
                    stream.write(TimingBatch((deaf,)))
                    with contextlib.suppress(NoAnswer):
                        await board.changed(timeout_s=0.05)
            assert partner.asked >= 1
            assert function.samples == 0
            assert remote.error_ns(function) <= function.bound_at_ns(module.now_ns())
            # one of the partner's functions is impossible: refused, the others are used, the service lives
            assert board.value is not None
            assert [known.platform for known in board.value.functions] == ["uav2"]
            assert "1 of 2 refused" in process.stderr()
            measured = await function_where(board, stream, remote, lambda function: function.samples > 0)
            assert remote.error_ns(measured) <= measured.bound_at_ns(module.now_ns())


async def test_wall_clock_step_is_fault_and_stamps_hold(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    config = make_node(tmp_path)
    set_ns = [0]
    monkeypatch.setattr("swarmd.timesync.service.utc_ns", lambda: utc_ns() + set_ns[0])
    async with spawn(config, "health"), Module("timesync", config_dir=config) as module:
        faults = module.stream_reader("health/faults", Fault)
        running = asyncio.create_task(TimeSync(module, settings.Config()).run())
        try:
            async with asyncio.timeout(PATIENCE_S):
                while not await is_known(module, "timesync/wall_clock"):
                    pass
                before_ns = module.now_ns()
                set_ns[0] = -3_600_000_000_000
                found = await faults.next()
                while (found.check, found.phase) != ("timesync/wall_clock", Phase.CONFIRMED):
                    found = await faults.next()
            assert (found.state, found.level) == ("stepped", "warn")
            assert "-3600" in found.freeze
            assert 0 < module.now_ns() - before_ns < PATIENCE_S * 1e9
            assert sum("stepped by -3600.0 s" in record.message for record in caplog.records) == 1
        finally:
            running.cancel()
            await asyncio.wait([running])


async def is_known(module: Module, check: str) -> bool:
    """Whether the monitor has a passing report of the check."""
    with contextlib.suppress(NoAnswer, NotFound):
        report = await module.request("sys/health/state", Empty(), HealthReport)
        return any((one.check, one.state) == (check, OK_STATE) for one in report.checks)
    return False
