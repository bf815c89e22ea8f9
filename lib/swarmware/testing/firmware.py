"""Firmware of a serial chassis on a pseudo-terminal, for tests of drivers without a device."""

import asyncio
from pathlib import Path
from typing import Final

import msgspec

from swarmware.devices.chassis_frames import Telemetry, command, frame_decoder, report_frame
from swarmware.errors import WireError
from swarmware.runtime.pseudo_terminal import PseudoTerminal
from swarmware.types.chassis import ChassisAction, ChassisOrder, ChassisReport
from swarmware.types.vehicle import BatteryState, Setpoint

REPORT_S: Final = 0.05
WATCHDOG_S: Final = 0.5
_MOTORS: Final = {ChassisAction.ARM: True, ChassisAction.DISARM: False, ChassisAction.KILL: False}


class ChassisFirmware:
    """Follows `chassis-protocol.md` behind a file that a driver opens; it starts and ends in an event loop.

    `link`: file of the line, present from `plug` to `unplug`.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self.report = ChassisReport(armed=False, landed=True)
        """Report of the chassis; a test may change it."""
        self.battery: BatteryState | None = BatteryState(24.5, 3.25, 0.75)
        self.gains: dict[str, float] = {"rate_kp": 0.1}
        """Gains that it knows, with their values."""
        self.setpoints: list[Setpoint] = []
        """Set-points in the order of their arrival."""
        self.calibrations = 0
        """Executed orders to calibrate."""
        self.ignored_orders = 0
        """Orders that it shall ignore, as if they had been lost; counts down."""
        self.noise = b""
        """Bytes before each report, as of a disturbed line."""
        self.refused_frames = 0
        """Valid frames without a valid content."""
        self._decoder = frame_decoder()
        self._line: PseudoTerminal | None = None
        self._reports: asyncio.Task[None] | None = None
        self._setpoint_s = 0.0

    def plug(self) -> None:
        """Makes the line and begins to report."""
        self._line = PseudoTerminal(self.link, self._take)
        self._reports = asyncio.get_running_loop().create_task(self._report_always(), name="chassis firmware")

    def unplug(self) -> None:
        """Removes the line; its state is kept, as with a supply of its own."""
        if self._reports is not None:
            self._reports.cancel()
            self._reports = None
        if self._line is not None:
            self._line.close()
            self._line = None

    async def _report_always(self) -> None:
        while True:
            self._send()
            await asyncio.sleep(REPORT_S)

    def _send(self) -> None:
        quiet = asyncio.get_running_loop().time() - self._setpoint_s > WATCHDOG_S
        content = Telemetry(self.report, self.report.armed and quiet, self.battery)
        if self._line is not None:
            self._line.write(self.noise + report_frame(content))

    def _take(self, data: bytes) -> None:
        for frame in self._decoder.feed(data):
            try:
                found = command(frame)
            except WireError:
                self.refused_frames += 1
                continue
            if isinstance(found, Setpoint):
                self._setpoint_s = asyncio.get_running_loop().time()
                self.setpoints.append(found)
            elif self.ignored_orders:
                self.ignored_orders -= 1
            else:
                if found.number > self.report.answered:
                    self.report = self._executed(found)
                self._send()

    def _executed(self, order: ChassisOrder) -> ChassisReport:
        """The report after an order; a refusal changes nothing else."""
        reason = ""
        armed = _MOTORS.get(order.action, self.report.armed)
        if order.action is ChassisAction.GAINS:
            unknown = order.gains.keys() - self.gains.keys()
            if unknown:
                reason = f"no gain {', '.join(sorted(unknown))}"
            else:
                self.gains.update(order.gains)
        elif order.action is ChassisAction.CALIBRATE:
            self.calibrations += 1
        return msgspec.structs.replace(self.report, armed=armed, answered=order.number, refused=reason)
