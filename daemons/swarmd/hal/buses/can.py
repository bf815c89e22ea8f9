"""A CAN bus with python-can, which receives frames as they arrive and sends without waiting."""

import asyncio
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import msgspec

from swarmd.hal.buses.bus import Bus
from swarmd.hal.driver import DeviceError, DeviceGone

if TYPE_CHECKING:
    from can import BusABC

_WAIT_S: Final = 0.2
"""Maximum time until the thread of a closed bus ends."""


class CanFrame(msgspec.Struct, frozen=True, gc=False):
    """A data frame with a 29-bit identifier."""

    id: int
    data: bytes


class CanBus(Bus):
    """An open CAN interface, whose frames are received in a thread and passed on in the event loop.

    `interface`: a name of python-can: `socketcan`, `virtual`, `slcan`. Raises: DeviceError, DeviceGone.
    """

    def __init__(self, interface: str, channel: str, on_frame: Callable[[CanFrame], None]) -> None:
        try:
            import can
        except ModuleNotFoundError as error:
            raise DeviceError(
                f"CAN: the module {error.name} is missing: pip install 'swarmware[can]'"
            ) from error
        self.path = f"{interface}:{channel}"
        self.dropped = 0
        """Number of unsent frames, because no controller acknowledges or the queue is full."""
        self._error, self._message = can.CanError, can.Message
        self._on_frame = on_frame
        self._lost = ""
        self._closed = threading.Event()
        self._loop = asyncio.get_running_loop()
        try:
            self._bus: BusABC = can.Bus(interface=interface, channel=channel)
        except (can.CanError, OSError, ValueError) as error:
            raise DeviceGone(f"{self.path}: {error}") from error
        threading.Thread(target=self._receive, name=f"can-{channel}", daemon=True).start()

    def _receive(self) -> None:
        """Body of the thread of the bus: receives until the bus is closed or lost, and shuts the bus down."""
        try:
            while not self._closed.is_set():
                # a bounded wait, so that the thread sees a closed bus
                message = self._bus.recv(_WAIT_S)
                if message is not None and message.is_extended_id and not message.is_error_frame:
                    frame = CanFrame(message.arbitration_id, bytes(message.data))
                    # the driver belongs to the event loop, and must not be called in this thread
                    self._loop.call_soon_threadsafe(self._pass, frame)
        except (self._error, OSError, ValueError) as error:
            self._lost = f"{self.path}: lost: {error}"
        except RuntimeError:
            return  # the event loop has ended
        finally:
            self._bus.shutdown()

    def _pass(self, frame: CanFrame) -> None:
        if not self._closed.is_set():
            self._on_frame(frame)

    def check(self) -> None:
        """Raises DeviceGone when the interface was lost."""
        if self._lost:
            raise DeviceGone(self._lost)

    def send(self, frame: CanFrame) -> None:
        """Sends a frame, or counts it as dropped. Raises: DeviceGone when the interface is lost."""
        self.check()
        try:
            self._bus.send(self._message(arbitration_id=frame.id, data=frame.data, is_extended_id=True), 0)
        except (self._error, OSError):
            self.dropped += 1

    def close(self) -> None:
        """Ends the thread, which then closes the interface."""
        self._closed.set()
