"""Base of the drivers of a chassis: set-points with a watchdog, and orders that the reports answer."""

import asyncio
import logging
from abc import abstractmethod
from collections.abc import Coroutine
from typing import Any, Final

from swarmd.hal.config import ChassisConfig
from swarmd.hal.core.chassis_core import REPEAT_NS, SILENT_NS, ChassisCore
from swarmd.hal.driver import Actuator, DeviceError
from swarmware.errors import Denied, NoAnswer
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.module.wakeup import Wakeup
from swarmware.module.writer import BoardWriter
from swarmware.types.chassis import ChassisAction, ChassisOrder, ChassisReport
from swarmware.types.control import ControlState, Drive, DriveMode
from swarmware.types.vehicle import Setpoint, VehicleMode, VehicleState

log = logging.getLogger("swarm.hal")

_REFRESH_NS: Final = 1_000_000_000
"""Period at which an unchanged `vehicle/state` is published again."""


class Chassis(Actuator):
    """Base of the drivers of chassis, which differ only in the connection to their device.

    A driver implements `send_setpoint` and `send_order`, and passes each report of the device to `on_report`.
    """

    def __init__(self, name: str, config: ChassisConfig) -> None:
        self.name = name
        self._config = config
        self.period_s = self._period_s(resting=False)
        self._core = ChassisCore(config.watchdog_s)
        self._answers: Wakeup | None = None
        self._one_by_one = asyncio.Lock()
        """Lock of an order until it is answered; a kill does not wait for the lock."""
        self._gains = dict(config.gains)
        """Gains in force, from the configuration and later requests."""
        self._gains_order: ChassisOrder | None = None
        """Order with the gains after the opening, or None before it is sent."""
        self._drive: BoardReader[Drive] | None = None
        self._taken: Drive | None = None
        self._control: BoardReader[ControlState] | None = None
        self._state: BoardWriter[VehicleState] | None = None
        self._written: tuple[VehicleState, int] | None = None
        """The state that was published last, and its instant."""
        self._following: asyncio.Task[None] | None = None
        self.module: Module | None = None
        """Module of the hardware abstraction, or None before the first `open`."""

    @abstractmethod
    def send_setpoint(self, setpoint: Setpoint, stamp_ns: int) -> None:
        """Sends a set-point to the device."""

    @abstractmethod
    def send_order(self, order: ChassisOrder) -> None:
        """Sends an order to the device, for the first time or again."""

    @property
    def state(self) -> VehicleState | None:
        """State of the vehicle by the newest report, or None before the first report."""
        report = self._core.report
        return None if report is None else self._state_of(report)

    def _state_of(self, report: ChassisReport) -> VehicleState:
        """State of the vehicle from a report and the mode that control has published."""
        control = None if self._control is None else self._control.value
        auto = control is None or control.mode is DriveMode.AUTO
        return VehicleState(report.armed, report.landed, VehicleMode.AUTO if auto else VehicleMode.MANUAL)

    async def open(self, module: Module) -> None:
        """Opens the board of set-points and the state of the vehicle."""
        self.module = module
        # a reopened device may be another one, so its state and open orders are forgotten
        self._core.on_opened(module.now_ns())
        self._gains_order = None
        self._answers = Wakeup()
        self._drive, self._taken = module.reader(self._config.drive, Drive), None
        self._control = module.reader("control/state", ControlState)
        self._state = self.managed(module, module.writer("vehicle/state", VehicleState))
        self._written = None

    def start(self, following: Coroutine[Any, Any, None]) -> None:
        """Runs a coroutine that receives the reports of the device, until the driver is closed."""
        if self.module is not None:
            self._following = self.module.start(following, f"reports of {self.name}")

    async def close(self) -> None:
        """Closes the boards; the state of the vehicle is then unknown."""
        if self._following is not None:
            self._following.cancel()
            self._following = None
        if self._drive is not None:
            self._drive.close()
            self._drive = None
        if self._control is not None:
            self._control.close()
            self._control = None
        self._state = None
        await super().close()

    async def write(self, now_ns: int) -> bool:
        """Sends a due set-point, and repeats orders without an answer.

        Raises: DeviceError when the device has not reported for too long.
        """
        drive = self._drive
        if drive is None:
            return False
        if self._core.silent(now_ns):
            raise DeviceError(f"no report for more than {SILENT_NS / 1e9:g} s")
        command = drive.value
        # the identity of the value distinguishes a new set-point from a repeated read
        if command is not None and command is not self._taken:
            self._taken = command
            self._core.on_setpoint(command.setpoint, drive.local_stamp_ns or now_ns)
        for order in self._core.repeated(now_ns):
            self.send_order(order)
        self._send_gains(now_ns)
        self._publish(now_ns)
        state = self.state
        self.period_s = self._period_s(resting=state is not None and state.resting)
        output = self._core.output(now_ns)
        if output is None:
            return False
        self.send_setpoint(output.setpoint, output.stamp_ns)
        return True

    def _send_gains(self, now_ns: int) -> None:
        """Sends the gains when the opened device has sent its first report."""
        core = self._core
        if self._gains and self._gains_order is None and core.report is not None and core.idle:
            self._gains_order = core.on_order(ChassisAction.GAINS, now_ns, self._gains)
            self.send_order(self._gains_order)

    def failsafe(self, now_ns: int) -> str:
        """Reason of the fail-safe of an armed chassis without set-points, or "" without a fail-safe."""
        if not self._core.failsafe(now_ns):
            return ""
        return f"no set-point in {self._config.drive} for more than {self._config.watchdog_s:g} s"

    def on_report(self, report: ChassisReport, stamp_ns: int) -> None:
        """Takes a report of the device, with the instant of its creation."""
        order = self._gains_order
        if order is not None and report.answered >= order.number and self._core.has_open(order):
            if report.answered > order.number:
                self._gains_order = None  # overtaken by a later order, so the gains are sent again
            elif report.refused:
                log.warning("chassis %s: gains refused: %s", self.name, report.refused)
            else:
                log.info("chassis %s: gains set", self.name)
        self._core.on_report(report, stamp_ns)
        self._publish(stamp_ns)
        if self._answers is not None:
            self._answers.notify()

    async def execute(self, action: ChassisAction, gains: dict[str, float] | None = None) -> VehicleState:
        """Sends an order, and repeats it until the device has answered; returns the state of the vehicle
        then.

        Raises: Denied with the reason of the device; NoAnswer when the device is closed or does not answer.
        """
        if action is ChassisAction.KILL:
            # at once, and without a queue: a kill is the last resort of an operator
            return await self._execute(action, {})
        async with self._one_by_one:
            if self._core.killing:
                raise Denied(f"{action}: a kill is being executed")
            # gains are kept only after the device has accepted them, and sent again after each opening
            state = await self._execute(action, gains or {})
            self._gains.update(gains or {})
            return state

    async def _execute(self, action: ChassisAction, gains: dict[str, float]) -> VehicleState:
        module, answers, core = self.module, self._answers, self._core
        if module is None or answers is None or self._state is None:
            raise NoAnswer(f"chassis {self.name}: {action}: the device is not open; see `swarmctl hal ls`")
        end_ns = module.now_ns() + round(self._config.answer_s * 1e9)
        order = core.on_order(action, module.now_ns(), gains)
        try:
            self.send_order(order)
            while (report := core.answer(order)) is None:
                now_ns = module.now_ns()
                if now_ns >= end_ns:
                    limit_s = self._config.answer_s
                    raise NoAnswer(f"chassis {self.name}: {action}: not answered within {limit_s:g} s")
                # wakes for the repetition even without a report
                await answers.wait(min(end_ns - now_ns, REPEAT_NS) / 1e9)
                for due in core.repeated(module.now_ns()):
                    self.send_order(due)
        finally:
            core.forget(order)
        if report.refused:
            raise Denied(report.refused)
        return self._state_of(report)

    def _publish(self, now_ns: int) -> None:
        state = self.state
        if state is None or self._state is None:
            return
        if self._written is None or self._written[0] != state or now_ns - self._written[1] >= _REFRESH_NS:
            self._written = (state, now_ns)
            self._state.write(state, now_ns)

    def _period_s(self, *, resting: bool) -> float:
        rate_hz = min(self._config.rate_hz, self._config.rest_hz) if resting else self._config.rate_hz
        return 1 / rate_hz
