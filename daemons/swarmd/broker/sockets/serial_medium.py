"""A serial line as a medium: datagrams framed by COBS with a CRC, written at the pace of the line."""

import asyncio
import logging
import time
from typing import Final

from swarmd.broker.config import SerialMedium
from swarmd.broker.core.swarm.media.line_frames import LineReceiver, LineSender
from swarmd.broker.core.swarm.media.line_queue import LineQueue
from swarmd.broker.core.swarm.media.medium import Address, serial_medium
from swarmd.broker.sockets.medium import DatagramMedium, MediumDatagram, OnArrival, OnLine
from swarmware.errors import NotFound, SwarmError
from swarmware.runtime.serial_port import SerialPort
from swarmware.types.traffic import Refused

AGAIN_S: Final = 0.5
"""Period in which an unplugged line is looked for."""

log = logging.getLogger("swarm.broker")


class SerialLineMedium(DatagramMedium):
    """One serial line; all nodes at its other end get everything."""

    def __init__(
        self,
        config: SerialMedium,
        loop: asyncio.AbstractEventLoop,
        refused: Refused,
        on_arrival: OnArrival,
        on_line: OnLine,
    ) -> None:
        """`on_line`: called when the line opens, and when it cannot be opened or is unplugged."""
        self._refused = refused
        self.medium = serial_medium(config)
        self._config = config
        self._loop = loop
        self._on_arrival = on_arrival
        self._on_line = on_line
        self._queue = LineQueue(config.baud)
        self._sender = LineSender()
        self._receiver = LineReceiver()
        self._port: SerialPort | None = None
        self._damaged = 0
        self._named: set[str] = set()
        """Reasons of refused frames that the log has since the line was opened."""
        self._problem = ""
        self._timer: asyncio.TimerHandle | None = None
        self._retry: asyncio.TimerHandle | None = None
        self._is_closed = False
        self._open()

    def send_to_all(self, data: bytes) -> bool:
        """Sends a beacon when the line is free; the next one takes its place if it waits too long."""
        if self._port is None:
            return False
        self._queue.put_beacon(data)
        self._write()
        return True

    def send(self, data: bytes, address: Address, *, urgent: bool = False) -> bool:
        """Sends a datagram when the line is free; False without a line, or without room."""
        if self._port is None or not self._queue.put(data, urgent=urgent):
            return False
        self._write()
        return True

    def receive(self) -> None:
        """Nothing waits: bytes are taken as they arrive."""

    def _open(self) -> None:
        self._retry = None
        try:
            self._port = SerialPort(self._config.device, self._config.baud, self._take, self._unplugged)
        except SwarmError as error:
            self._report(str(error))
            self._look_again()
        else:
            # what waited before the line was unplugged is stale
            self._queue.clear()
            self._named.clear()
            self._report("")

    def _unplugged(self) -> None:
        port, self._port = self._port, None
        if port is None:
            return
        # the device says why it is gone, which the log and the operator need
        try:
            port.check()
        except NotFound as error:
            self._report(str(error))
        port.close()
        self._look_again()

    def _look_again(self) -> None:
        if not self._is_closed:
            self._retry = self._loop.call_later(AGAIN_S, self._open)

    def _report(self, problem: str) -> None:
        if problem == self._problem:
            return
        if problem:
            log.warning("medium %s: %s", self._config.name, problem)
        else:
            log.info("medium %s: %s is open again", self._config.name, self._config.device)
        self._problem = problem
        self._on_line(self._config.name, problem)

    def _write(self) -> None:
        while self._port is not None and (datagram := self._queue.take(time.monotonic_ns())) is not None:
            try:
                self._port.write(self._sender.frame(datagram))
            except NotFound:
                return  # the line has reported itself
        now_ns = time.monotonic_ns()
        due_ns = self._queue.deadline_ns(now_ns)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if due_ns is not None and self._port is not None:
            self._timer = self._loop.call_later((due_ns - now_ns) / 1e9 + 0.0005, self._on_timer)

    def _on_timer(self) -> None:
        self._timer = None
        self._write()

    def _take(self, data: bytes) -> None:
        rx_ns = time.monotonic_ns()
        for number, datagram in self._receiver.feed(data):
            self._on_arrival(
                self.medium, MediumDatagram(datagram, (self.medium.name, 0), rx_ns, number=number)
            )
        self._count_refused()

    def _count_refused(self) -> None:
        counts = self._receiver.refused
        found = counts.total() - self._damaged
        if not found:
            return
        self._damaged += found
        self._refused.damaged += found
        # noise would fill the log; each reason once for each opening
        for reason in counts.keys() - self._named:
            self._named.add(reason)
            log.warning(
                "medium %s: a frame on %s was refused: %s; noise, or the other end has not %d baud",
                self._config.name,
                self._config.device,
                reason,
                self._config.baud,
            )

    def close(self) -> None:
        """Closes the line for other processes."""
        self._is_closed = True
        for timer in (self._timer, self._retry):
            if timer is not None:
                timer.cancel()
        port, self._port = self._port, None
        if port is not None:
            port.close()
