"""The broker's UDP sockets: what comes close together is taken together, and nothing waits for long."""

import asyncio
import contextlib
import socket
from collections.abc import Callable, Iterator
from typing import Any, Final, cast

import pytest

from swarmd.broker.config import Config
from swarmd.broker.core.swarm.media.medium import MediumProfile
from swarmd.broker.sockets.medium import MediumDatagram
from swarmd.broker.sockets.udp import REST_WINDOW_NS, TURN, WINDOW_NS, Udp, main_network
from swarmware.model.clock import Clock

LOOPBACK: Final = "127.0.0.1"
WINDOW_S: Final = WINDOW_NS / 1e9
REST_WINDOW_S: Final = REST_WINDOW_NS / 1e9


class Loop:
    """What the sockets ask of an event loop, in virtual time."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.readers: dict[int, Callable[[], None]] = {}
        self.timers: list[asyncio.TimerHandle] = []

    def time(self) -> float:
        return self.now_s

    def add_reader(self, fd: int, callback: Callable[[], None]) -> None:
        self.readers[fd] = callback

    def remove_reader(self, fd: int) -> None:
        self.readers.pop(fd, None)

    def call_later(self, delay_s: float, callback: Callable[[], None]) -> asyncio.TimerHandle:
        when_s = int(self.now_s * 1000 + 1e-6) / 1000 + delay_s  # uvloop counts whole milliseconds
        timer = asyncio.TimerHandle(when_s, callback, (), cast(asyncio.AbstractEventLoop, self))
        self.timers.append(timer)
        return timer

    def get_debug(self) -> bool:
        return False

    def _timer_handle_cancelled(self, _timer: asyncio.TimerHandle) -> None:
        pass

    def call_exception_handler(self, context: dict[str, Any]) -> None:
        raise context["exception"]

    def readable(self) -> bool:
        """Reports a readable socket; returns whether a reader was registered."""
        for callback in list(self.readers.values())[:1]:
            callback()
            return True
        return False

    def later(self, seconds: float) -> None:
        """The timers that are due by then."""
        self.now_s += seconds
        due = [timer for timer in self.timers if timer.when() <= self.now_s]
        self.timers = [timer for timer in self.timers if timer not in due]
        for timer in due:
            if not timer.cancelled():
                timer._run()


class LoopClock(Clock):
    """A node's clock in the time of the loop."""

    __slots__ = ("_loop",)

    def __init__(self, loop: Loop) -> None:
        super().__init__(offset_s=-77.0)
        self._loop = loop

    def now_ns(self) -> int:
        return self.from_mono_ns(round(self._loop.now_s * 1e9))


class Ends:
    """The sockets, and somebody who writes to them."""

    def __init__(self) -> None:
        self.loop = Loop()
        self.got: list[bytes] = []
        self.fails = False
        config = Config(multicast_group="", bind_address=LOOPBACK)
        loop = cast(asyncio.AbstractEventLoop, self.loop)
        self.udp = Udp(main_network(config), loop, LoopClock(self.loop), self.take)
        self.sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def take(self, _: MediumProfile, arrival: MediumDatagram) -> None:
        self.got.append(arrival.data)
        if self.fails:
            raise ZeroDivisionError

    def send(self, *parts: bytes) -> None:
        for part in parts:
            self.sender.sendto(part, (LOOPBACK, self.udp.port))


@pytest.fixture
def ends() -> Iterator[Ends]:
    ends = Ends()
    yield ends
    ends.udp.close()
    ends.sender.close()
    assert ends.loop.readers == {}
    assert all(timer.cancelled() for timer in ends.loop.timers)


def test_datagram_after_pause_is_taken_at_once(ends: Ends) -> None:
    for number in range(3):
        ends.send(b"%d" % number)
        assert ends.loop.readable()
        assert len(ends.got) == number + 1
        ends.loop.later(2 * WINDOW_S)


def test_datagrams_close_together_are_taken_together(ends: Ends) -> None:
    ends.send(b"1")
    ends.loop.readable()
    ends.loop.later(WINDOW_S / 2)
    ends.send(b"2")
    assert ends.loop.readable()
    ends.send(b"3", b"4")
    assert not ends.loop.readable(), "the timer takes them"
    assert ends.got == [b"1", b"2"]
    ends.loop.later(WINDOW_S)
    assert ends.got == [b"1", b"2", b"3", b"4"]
    ends.send(b"5")
    assert not ends.loop.readable()
    ends.loop.later(WINDOW_S)
    assert ends.got[-1] == b"5", "none waits longer"


@pytest.mark.parametrize(("period_s", "window_s"), [(0.1, WINDOW_S), (0.24, WINDOW_S), (0.25, REST_WINDOW_S)])
def test_datagrams_are_taken_at_multiples_of_window(ends: Ends, period_s: float, window_s: float) -> None:
    ends.udp.set_min_period(round(period_s * 1e9))
    ends.loop.now_s = 100.004
    for _ in range(2):
        ends.send(b"x")
        ends.loop.readable()
    instants = []
    for _ in range(20):
        [timer] = ends.loop.timers
        instants.append(round(timer.when(), 6))
        ends.send(b"y")
        ends.loop.later(timer.when() + 0.0015 - ends.loop.now_s)  # the loop is busy for a moment
    assert instants == [round(100 + (count + 1) * window_s, 6) for count in range(20)]
    assert ends.loop.readers == {}, "it is read by the timer alone: one wake for each window"


def test_datagram_after_empty_timer_is_taken_at_once(ends: Ends) -> None:
    for _ in range(2):
        ends.send(b"x")
        ends.loop.readable()
    ends.loop.later(WINDOW_S)
    ends.loop.later(WINDOW_S)
    assert ends.loop.timers == []
    ends.send(b"y")
    assert ends.loop.readable()
    assert ends.got[-1] == b"y"


def test_datagram_before_timer_keeps_it_running(ends: Ends) -> None:
    for _ in range(2):
        ends.send(b"x")
        ends.loop.readable()
    for _ in range(3):
        ends.send(b"y")
        ends.udp.receive()  # as the broker does at the same instant, before its beacon
        ends.loop.later(WINDOW_S)
        assert len(ends.loop.timers) == 1
        assert ends.loop.readers == {}
    for _ in range(2):
        ends.loop.later(WINDOW_S + 0.002)
    assert ends.loop.timers == []


def test_a_flood_is_taken_without_pauses(ends: Ends) -> None:
    ends.send(*[b"x"] * (2 * TURN + 1))
    for turn in (1, 2):
        assert ends.loop.readable()
        assert len(ends.got) == turn * TURN, "the event loop gets its turn in between"
    assert ends.loop.readable()
    assert len(ends.got) == 2 * TURN + 1


def test_arrived_datagram_is_readable_before_timer(ends: Ends) -> None:
    for _ in range(2):
        ends.send(b"x")
        ends.loop.readable()
    ends.send(b"y")
    ends.udp.receive()
    assert ends.got[-1] == b"y"


def test_fault_in_taker_does_not_leave_sockets_unread(ends: Ends) -> None:
    for _ in range(2):
        ends.send(b"x")
        ends.loop.readable()
    ends.fails = True
    ends.send(b"y")
    with contextlib.suppress(ZeroDivisionError):
        ends.loop.later(WINDOW_S)
    ends.fails = False
    ends.send(b"z")
    assert ends.loop.readable()
    assert ends.got[-1] == b"z"
