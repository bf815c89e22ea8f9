"""Requests of functions in rounds, which begin at a deadline and end with the last answer."""

from typing import Final

from swarmd.timesync.config import Config
from swarmd.timesync.core.exchange import (
    ASK_FIRST_NS,
    ASK_NS,
    YOUNG_SAMPLES,
    Action,
    ExchangeCore,
    ReadRouteTable,
    RequestFunctions,
)
from swarmd.timesync.core.peer import Exchange
from swarmd.timesync.core.time_core import PeerExchange, TimeCore
from swarmware.testing.virtual import VirtualTime
from swarmware.types.net import Routes, RouteState
from swarmware.types.time import Conversion, TimeFunctions

SECOND: Final = 1_000_000_000
DELAY: Final = 100_000
FAR: Final = RouteState("uav9", 9, "uav2", 512, 2, 0, 0)


class Rig:
    """Both cores of one node in virtual time; the test decides when requests are answered."""

    def __init__(self, *, compose: bool = True) -> None:
        self.virtual = VirtualTime(SECOND)
        config = Config(compose=compose)
        self.time = TimeCore("uav1", "main", 1, 10, config, first_epoch=40)
        self.core = ExchangeCore(self.time, config, self.virtual.now_ns)
        self.driver = self.virtual.drive(self.core, self.perform)
        self.routes: Routes | None = None
        self.requested: list[tuple[float, str]] = []
        self.answers = True
        self.driver.feed()

    def perform(self, action: Action) -> None:
        now_ns = self.virtual.now_ns
        match action:
            case ReadRouteTable():
                self.driver.feed(self.core.on_routes_read(self.routes, now_ns))
            case RequestFunctions(platform):
                self.requested.append((now_ns / SECOND, platform))
                if self.answers:
                    self.driver.feed(self.core.on_request_ended(platform, now_ns))

    def receive(self, hardware: int, *, echo: bool = True) -> None:
        """One datagram of a neighbour, with or without an echo of ours."""
        now_ns = self.virtual.now_ns
        back = (now_ns - 50_000_000, DELAY) if echo else ()
        sample = PeerExchange(f"uav{hardware}", "main", hardware, 5, Exchange(now_ns, -DELAY, *back))
        self.time.on_exchange(sample, now_ns)
        self.time.on_timer(now_ns)
        self.driver.feed()

    def requests(self, seconds: float) -> list[float]:
        before = len(self.requested)
        self.virtual.run_for(seconds)
        return [at_s for at_s, _ in self.requested[before:]]


def test_unmeasurable_neighbour_is_asked_every_two_seconds() -> None:
    rig = Rig()
    rig.virtual.run_for(0.5)
    rig.receive(2, echo=False)
    assert rig.requests(6.4) == [1.5, 3.5, 5.5, 7.5]
    rig.receive(2)
    assert rig.requests(10.0) == [], "it is measured, and there is no platform behind it"


def test_while_an_answer_is_awaited_no_round_begins() -> None:
    rig = Rig()
    rig.answers = False
    rig.receive(2, echo=False)
    assert len(rig.requests(30.0)) == 1
    rig.answers = True
    rig.driver.feed(rig.core.on_request_ended("uav2", rig.virtual.now_ns))
    assert len(rig.requests(ASK_FIRST_NS / SECOND)) == 1


def test_neighbour_on_route_is_asked_often_first() -> None:
    rig = Rig()
    for _ in range(40):
        rig.virtual.run_for(0.1)
        rig.receive(2)
    rig.routes = Routes((FAR,))
    assert len(rig.requests(6.0)) == 3
    rig.receive(2)
    known = Conversion(
        "uav9", "main", 9, 7, 0, 0.0, rig.virtual.now_ns, 1000, 100, 1e-9, 1, samples=YOUNG_SAMPLES
    )
    functions = TimeFunctions("uav2", "main", 5, rig.virtual.now_ns, (known,))
    rig.time.on_functions(functions, rig.virtual.now_ns)
    rig.virtual.run_for(2.0)
    rig.receive(2)
    asked = rig.requests(12.0)
    assert len(asked) <= 2, "each ten seconds"
    assert {platform for _, platform in rig.requested} == {"uav2"}
    assert ASK_NS == 10 * SECOND


def test_only_neighbours_without_functions_are_asked() -> None:
    rig = Rig(compose=False)
    rig.routes = Routes((FAR,))
    rig.receive(2)
    assert rig.requests(30.0) == []
