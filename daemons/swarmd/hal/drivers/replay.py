"""Replay of raw packets from a recording, in place of a device."""

from pathlib import Path

from swarmd.hal.config import Config, ReplayDriver
from swarmd.hal.core.packet_clock import PacketClock
from swarmd.hal.driver import Device, DeviceError, Sensor, Site
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.scalar import Blob


class Replay(Sensor):
    """Publishes the packets of a file as a stream resource."""

    name = "replay"

    def __init__(self, config: ReplayDriver, folder: Path) -> None:
        self.period_s = 1 / config.wake_hz
        self._config = config
        self._file = folder / config.file
        self._packets: tuple[Blob, ...] = ()
        self._writer: BoardWriter[Blob] | None = None
        self._clock: PacketClock | None = None

    async def open(self, module: Module) -> None:
        """Opens the recording. Raises: DeviceError when it cannot be read, or has an invalid length."""
        config = self._config
        try:
            data = self._file.read_bytes()
        except OSError as error:
            raise DeviceError(f"recording {self._file}: {error.strerror}") from error
        size = config.packet_bytes
        if not data or len(data) % size:
            raise DeviceError(f"recording {self._file}: {len(data)} bytes, expected packets of {size} bytes")
        self._packets = tuple(Blob(data[at : at + size]) for at in range(0, len(data), size))
        writer = module.stream_writer(
            config.path, Blob, rate_hz=config.packets_hz, slots=config.slots, slot_bytes=size + 128
        )
        self._writer = self.managed(module, writer)
        self._clock = None

    async def read(self, now_ns: int) -> bool:
        """Publishes the packets that are due, each with its own stamp."""
        config, writer = self._config, self._writer
        if writer is None:
            return False
        if self._clock is None:
            self._clock = PacketClock(config.packets_hz, len(self._packets), now_ns, loop=config.loop)
        some = False
        for packet in self._clock.due(now_ns):
            writer.write(self._packets[packet.index], packet.stamp_ns)
            some = True
        return some

    async def close(self) -> None:
        """Closes the writer and releases the recording."""
        self._packets = ()
        await super().close()


def make(config: Config, site: Site) -> list[Device]:
    """Creates the driver of the recording."""
    return [Replay(config.replay, Path(site.data_dir))]
