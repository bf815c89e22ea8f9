"""Rising edges on one line of a GPIO chip of the kernel, with their instants."""

import asyncio
import fcntl
import os
import struct
from collections.abc import Callable
from typing import Final

from swarmd.hal.buses.bus import Bus, DeviceFile, transfer_error
from swarmd.hal.driver import DeviceGone

_GET_LINE: Final = 0xC250B407
"""GPIO_V2_GET_LINE_IOCTL. Source: Linux, uapi/linux/gpio.h."""
_REQUEST: Final = struct.Struct("=64I32sQI20s240sII20si")
"""struct gpio_v2_line_request: offsets, consumer, configuration (flags, attributes), lines, buffer, file."""
_INPUT: Final = 1 << 2
_RISING: Final = 1 << 4
_EVENT: Final = struct.Struct("=QIIII24s")
"""struct gpio_v2_line_event: instant, kind, line, sequence of the request, sequence of the line."""
_EVENTS: Final = 16


class GpioEdges(Bus):
    """Reports each rising edge of one line to `on_edge`, with its instant in CLOCK_MONOTONIC.

    `on_lost` is called after edges were lost in the kernel's full buffer. Raises: DeviceGone, DeviceError.
    """

    def __init__(
        self, chip: str, line: int, on_edge: Callable[[int], None], on_lost: Callable[[], None]
    ) -> None:
        self.path = f"{chip} line {line}"
        self._on_edge = on_edge
        self._on_lost = on_lost
        self._sequence = 0
        self._lost = ""
        file = DeviceFile(chip)
        request = bytearray(
            _REQUEST.pack(line, *[0] * 63, b"swarm", _INPUT | _RISING, 0, b"", b"", 1, 0, b"", 0)
        )
        try:
            fcntl.ioctl(file.fd, _GET_LINE, request)
        except OSError as error:
            raise transfer_error(self.path, error) from error
        finally:
            file.close()
        # the kernel returns the descriptor of the line in the request, which stays open without the chip
        self._fd: int = _REQUEST.unpack(request)[-1]
        os.set_blocking(self._fd, False)
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._fd, self._readable)

    def _readable(self) -> None:
        try:
            data = os.read(self._fd, _EVENT.size * _EVENTS)
        except BlockingIOError:
            return
        except OSError as error:
            data, self._lost = b"", str(error.strerror)
        if not data:
            self._lost = self._lost or "end of file"
            self._loop.remove_reader(self._fd)
            return
        for stamp_ns, _, _, _, sequence, _ in _EVENT.iter_unpack(
            # whole events only
            data[: len(data) // _EVENT.size * _EVENT.size]
        ):
            # the kernel numbers the edges, so a step shows the edges that its full buffer has lost
            if self._sequence and sequence != self._sequence + 1:
                self._on_lost()
            self._sequence = sequence
            self._on_edge(stamp_ns)

    def check(self) -> None:
        """Checks that the line still exists. Raises: DeviceGone."""
        if self._lost:
            raise DeviceGone(f"{self.path}: lost: {self._lost}")

    def close(self) -> None:
        """Releases the line; further calls do nothing."""
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            os.close(self._fd)
            self._fd = -1
