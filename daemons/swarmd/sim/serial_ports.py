"""Serial lines of the simulated vehicle, as pseudo-terminals in a folder."""

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from swarmd.sim.core.serial_devices import SerialDevice, SerialDevices, SerialOutput
from swarmd.sim.core.simulation import SimulationOutput
from swarmware.module.module import Module
from swarmware.runtime.pseudo_terminal import PseudoTerminal
from swarmware.types.chassis import ChassisOrder, ChassisReport
from swarmware.types.vehicle import Setpoint, VehicleMode


class SerialPorts:
    """Lines of all devices, each in the file with its name; only the chassis evaluates received bytes.

    Raises: OSError when the folder cannot be written.
    """

    def __init__(
        self,
        module: Module,
        folder: Path,
        devices: SerialDevices,
        take: Callable[[Setpoint | ChassisOrder], None],
    ) -> None:
        self._module = module
        self._devices = devices
        self._take = take
        self._lines = {
            device: PseudoTerminal(folder / device.value, partial(self._received, device))
            for device in devices.present
        }

    def on_output(self, output: SimulationOutput, switch: VehicleMode) -> None:
        """Sends the measurements of an instant, and the position of the switch."""
        self._send(self._devices.on_output(output, switch))

    def on_report(self, report: ChassisReport) -> None:
        """Sends the report that answers an order."""
        self._send(self._devices.on_report(report, self._module.now_ns()))

    def _received(self, device: SerialDevice, data: bytes) -> None:
        if device is SerialDevice.CHASSIS:
            # the other devices of the vehicle only send
            for found in self._devices.on_bytes(data, self._module.now_ns()):
                self._take(found)

    def _send(self, outputs: Iterable[SerialOutput]) -> None:
        for output in outputs:
            self._lines[output.device].write(output.data)

    def close(self) -> None:
        """Closes all lines, as if the devices were unplugged."""
        for line in self._lines.values():
            line.close()
