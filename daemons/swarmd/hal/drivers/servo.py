"""Driver of servos and motor controllers that follow pulse widths (RC, 1 to 2 ms)."""

from swarmd.hal.blocking import BlockingDevice
from swarmd.hal.buses.end_writer import EndWriter
from swarmd.hal.buses.pwm import PwmChannel
from swarmd.hal.config import Config, ServoDriver
from swarmd.hal.driver import Actuator, Device, Site
from swarmd.hal.outputs import OutputBoards
from swarmware.module.module import Module


class Servos(BlockingDevice, Actuator):
    """Outputs of one chip, each with a board of set-points from -1 to 1 and a safe width."""

    name = "servo"

    def __init__(self, config: ServoDriver) -> None:
        self.period_s = 1 / config.rate_hz
        self._config = config
        self._channels: list[PwmChannel] = []
        self._widths_us: list[float] = []
        """Present pulse widths of the channels, or [] if unknown."""
        self._boards: OutputBoards | None = None
        self._end_writer: EndWriter | None = None

    async def open(self, module: Module) -> None:
        """Opens the boards; the outputs begin with their safe widths."""
        await super().open(module)
        self._boards = OutputBoards(module, self._config.outputs, self._config.watchdog_s)

    def connect(self) -> None:
        """Opens the channels. Raises: DeviceError, DeviceGone."""
        config = self._config
        for one in config.outputs:
            self._channels.append(PwmChannel(config.device, one.channel, 1 / config.rate_hz))
        # before the first set-point, so that no output has the width of a former process
        self._carry([one.safe_us for one in config.outputs])
        pairs = zip(self._channels, config.outputs, strict=True)
        texts = [text for channel, one in pairs for text in channel.texts(one.safe_us)]
        # set-points of a hanging driver are followed no longer than other old set-points
        self._end_writer = EndWriter(texts, config.watchdog_s)

    async def write(self, now_ns: int) -> bool:
        """Sets the widths that changed."""
        if self._boards is None:
            return False
        # the other process may have set safe widths, so the present ones are not known
        if self._end_writer is not None and self._end_writer.keep():
            self._widths_us = []
            for channel in self._channels:
                channel.forget()
        widths = [
            one.safe_us if value is None else one.center_us + value * one.range_us
            for one, value in zip(self._config.outputs, self._boards.values(now_ns), strict=True)
        ]
        if widths == self._widths_us:
            return False
        await self.in_thread(lambda: self._carry(widths))
        return True

    def _carry(self, widths_us: list[float]) -> None:
        """Sets the pulses, in the thread of the device."""
        self._widths_us = []
        for channel, width_us in zip(self._channels, widths_us, strict=True):
            channel.set_pulse(width_us)
        self._widths_us = widths_us

    def failsafe(self, now_ns: int) -> str:
        """Reason why an output is at its safe width."""
        return "" if self._boards is None else self._boards.failsafe(now_ns)

    def disconnect(self) -> None:
        """Sets the safe widths and closes the channels, in the thread of the device."""
        channels, self._channels = self._channels, []
        try:
            for channel, one in zip(channels, self._config.outputs, strict=False):
                channel.set_pulse(one.safe_us)
        finally:
            for channel in channels:
                channel.close()
            if self._end_writer is not None:
                self._end_writer.close()
                self._end_writer = None

    async def close(self) -> None:
        """Closes boards and channels; the outputs keep their safe widths."""
        await super().close()
        if self._boards is not None:
            self._boards.close()
            self._boards = None


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the outputs."""
    return [Servos(config.servo)]
