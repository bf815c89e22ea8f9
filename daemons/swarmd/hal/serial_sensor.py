"""Sensors that send unrequested on a serial line, whose measurements are published when they arrive."""

from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Final, Generic, Protocol, TypeVar

import msgspec

from swarmd.hal.buses.serial_line import SerialLine
from swarmd.hal.core.line_load import serial_use
from swarmd.hal.driver import DeviceError, Sensor
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter

T = TypeVar("T")
M = TypeVar("M", bound=msgspec.Struct)
T_co = TypeVar("T_co", covariant=True)

_NAMED: Final = 2
"""Number of the most frequent reasons that the error of a silent sensor names."""


class SensorDecoder(Protocol[T_co]):
    """Decoder for the bytes of a sensor."""

    refused: Counter[str]
    """Number of invalid frames or sentences, by the reason."""
    valid: int
    """Number of valid frames or sentences, including ignored types."""

    def feed(self, data: bytes) -> Iterator[T_co]: ...


class SerialSensor(Sensor, Generic[T]):
    """Base of the drivers of serial sensors; `read` checks the line.

    A driver that overrides `open` or `close` must call the overridden method, too. `silent_s`: time without a
    valid frame or sentence after which the sensor counts as failed.
    """

    silent_s = 5.0

    def __init__(
        self,
        name: str,
        device: str,
        baud: int,
        rate_hz: float,
        decoder: Callable[[], SensorDecoder[T]],
        bytes_s: float,
    ) -> None:
        """`bytes_s`: bytes that the sensor sends per second."""
        self.name = name
        self.period_s = 1 / rate_hz
        self.line_uses = (serial_use(device, baud, bytes_s),)
        self._device = device
        self._baud = baud
        self._make_decoder = decoder
        self._decoder = decoder()
        self._line: SerialLine | None = None
        self._published = self._counted = self._valid = 0
        self._received_ns = 0
        self.module: Module | None = None
        """Module of the hardware abstraction, or None before the first `open`."""

    @abstractmethod
    def publish(self, value: T, now_ns: int) -> bool:
        """Publishes a measurement; returns False if its type is ignored."""

    @property
    def refused(self) -> dict[str, int]:
        """Number of invalid frames or sentences since the line was opened, by the reason."""
        return self._decoder.refused

    async def open(self, module: Module) -> None:
        """Opens the line. Raises: DeviceGone, DeviceError."""
        self.module, self._decoder = module, self._make_decoder()
        self._valid, self._received_ns = 0, module.now_ns()
        self._line = SerialLine(self._device, self._baud, self._take)

    def _take(self, data: bytes) -> None:
        if self.module is None:
            return
        for value in self._decoder.feed(data):
            self._published += self.publish(value, self.module.now_ns())

    async def read(self, now_ns: int) -> bool:
        """Returns True if a measurement arrived since the last call.

        Raises: DeviceGone when the line is lost; DeviceError when no valid frame or sentence arrives.
        """
        if self._line is not None:
            self._line.check()
        if self._decoder.valid != self._valid:
            # ignored types count as well: they show that the sensor and its rate are right
            self._valid, self._received_ns = self._decoder.valid, now_ns
        elif now_ns - self._received_ns > self.silent_s * 1e9:
            counts = sorted(self.refused.items(), key=lambda item: -item[1])[:_NAMED]
            refused = ", ".join(f"{count} × {what}" for what, count in counts) or "none"
            raise DeviceError(f"{self._device}: nothing valid for {self.silent_s:g} s; refused: {refused}")
        # values are published as they arrive; the period only checks the line
        fresh = self._published != self._counted
        self._counted = self._published
        return fresh

    async def close(self) -> None:
        """Closes the line; a second call has no effect."""
        if self._line is not None:
            self._line.close()
            self._line = None
        await super().close()


class BoardSettings(Protocol):
    """Settings of a sensor that publishes one board."""

    @property
    def device(self) -> str: ...
    @property
    def baud(self) -> int: ...
    @property
    def rate_hz(self) -> float: ...
    @property
    def path(self) -> str: ...


class SerialBoard(SerialSensor[M], Generic[M]):
    """Base of the drivers of serial sensors that publish one board."""

    def __init__(
        self,
        name: str,
        settings: BoardSettings,
        cls: type[M],
        decoder: Callable[[], SensorDecoder[M]],
        message_bytes: int,
    ) -> None:
        """`message_bytes`: bytes that the sensor sends for each measurement."""
        rate_hz = settings.rate_hz
        super().__init__(name, settings.device, settings.baud, rate_hz, decoder, message_bytes * rate_hz)
        self._settings = settings
        self._cls = cls
        self._writer: BoardWriter[M] | None = None

    async def open(self, module: Module) -> None:
        """Opens the line and the board. Raises: DeviceGone, DeviceError."""
        await super().open(module)
        writer = module.writer(self._settings.path, self._cls, rate_hz=self._settings.rate_hz)
        self._writer = self.managed(module, writer)

    def publish(self, value: M, now_ns: int) -> bool:
        """Writes the board of the sensor."""
        if self._writer is None:
            return False
        self._writer.write(value, now_ns)
        return True
