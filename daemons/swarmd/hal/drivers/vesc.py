"""Driver of VESC motor controllers on a CAN bus."""

from collections import Counter
from typing import Final

from swarmd.hal.buses.can import CanBus, CanFrame
from swarmd.hal.config import Config, VescDriver
from swarmd.hal.core.line_load import can_use
from swarmd.hal.core.vesc import VescState, command
from swarmd.hal.driver import Actuator, Device, DeviceError, Site
from swarmd.hal.outputs import OutputBoards
from swarmware.errors import WireError
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.vehicle import MotorControllerState

_SILENT_NS: Final = 1_000_000_000
"""Time without a status after which a controller counts as failed; it sends 10 to 50 a second."""
_STATE_HZ: Final = 10.0
_COMMAND_BYTES: Final = 4
_STATUS_BYTES: Final = 8
_STATUS_HZ: Final = 50.0
"""Sizes of a command and of a status, and the highest rate of a status."""


class VescMotors(Actuator):
    """Motors that follow boards of set-points from -1 to 1, and get no current without a fresh set-point."""

    name = "vesc"

    def __init__(self, config: VescDriver) -> None:
        self.period_s = 1 / config.rate_hz
        frames = [(_COMMAND_BYTES, config.rate_hz), (_STATUS_BYTES, _STATUS_HZ)] * len(config.motors)
        self.line_uses = (can_use(config.device, frames),)
        self._config = config
        self._bus: CanBus | None = None
        self._boards: OutputBoards | None = None
        self._states: list[VescState] = []
        self._received_ns: list[int] = []
        """Instant of the newest status of each controller, or of the opening."""
        self._published_ns: list[int] = []
        self._module: Module | None = None
        self._writers: list[BoardWriter[MotorControllerState]] = []
        self.refused: Counter[str] = Counter()
        """Number of invalid frames, by the reason."""

    async def open(self, module: Module) -> None:
        """Opens the bus and the boards of all motors."""
        config, self._module = self._config, module
        self._states = [VescState(motor.controller) for motor in config.motors]
        self._received_ns = [module.now_ns() for _ in config.motors]
        self._published_ns = [0 for _ in config.motors]
        self._bus = CanBus(config.interface, config.device, self._take)
        self._boards = OutputBoards(module, config.motors, config.watchdog_s)
        for motor in config.motors:
            writer = module.writer(motor.state_path, MotorControllerState, rate_hz=_STATE_HZ, link="request")
            self._writers.append(self.managed(module, writer))

    def _take(self, frame: CanFrame) -> None:
        if self._module is None:
            return
        now_ns = self._module.now_ns()
        for i, state in enumerate(self._states):
            try:
                found = state.on_frame(frame.id, frame.data)
            except WireError as error:
                self.refused[str(error)] += 1
                continue
            if found is None:
                continue
            self._received_ns[i] = now_ns
            # controllers report more often than an operator or a log needs
            if now_ns - self._published_ns[i] >= 1e9 / _STATE_HZ:
                self._published_ns[i] = now_ns
                self._writers[i].write(found, now_ns)

    async def write(self, now_ns: int) -> bool:
        """Sends a command to each motor, at every call because the controllers have watchdogs.

        Raises: DeviceGone when the bus is lost; DeviceError when a controller is silent.
        """
        bus, boards, config = self._bus, self._boards, self._config
        if bus is None or boards is None:
            return False
        for motor, value in zip(config.motors, boards.values(now_ns), strict=True):
            if value is None:
                # no current lets the motor run out; a duty of 0 would brake it
                identifier, data = command(motor.controller, "current", 0.0)
            else:
                identifier, data = command(motor.controller, motor.quantity, value * motor.full_scale)
            bus.send(CanFrame(identifier, data))
        silent = [
            str(motor.controller)
            for motor, received_ns in zip(config.motors, self._received_ns, strict=True)
            if now_ns - received_ns > _SILENT_NS
        ]
        if silent:
            raise DeviceError(
                f"{bus.path}: controller {', '.join(silent)}: no status for more than 1 s;"
                f" {bus.dropped} frames not sent"
            )
        return bool(config.motors)

    def failsafe(self, now_ns: int) -> str:
        """Reason why a motor runs without current."""
        return "" if self._boards is None else self._boards.failsafe(now_ns)

    async def close(self) -> None:
        """Releases the motors, and closes bus and boards."""
        if self._bus is not None:
            for motor in self._config.motors:
                # the motors would otherwise run until the time-out of their controllers
                self._release(self._bus, motor.controller)
            self._bus.close()
            self._bus = None
        if self._boards is not None:
            self._boards.close()
            self._boards = None
        self._writers.clear()
        await super().close()

    def _release(self, bus: CanBus, controller: int) -> None:
        try:
            bus.send(CanFrame(*command(controller, "current", 0.0)))
        except DeviceError:
            return  # the bus is lost, and the controllers stop by their own time-out


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the motors."""
    return [VescMotors(config.vesc)]
