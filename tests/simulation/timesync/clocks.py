"""Two simulated clocks, the links between them, and the estimator that hears one at the other."""

import heapq
import math
from collections.abc import Callable
from random import Random
from typing import NamedTuple

from swarmd.timesync.config import Config
from swarmd.timesync.core.peer import ClockEstimator, Exchange
from swarmd.timesync.core.time_core import TimeCore
from swarmware.types.time import TimeFunctions

Delay = Callable[[Random, bool], float]

WANDER = 0.02e-6
"""Random walk of a quartz in 1/√s."""


PAUSE_S = Config().solve_s


def lan(random: Random, back: bool) -> float:
    return 50e-6 + random.expovariate(1 / 50e-6)


def uniform(random: Random, back: bool) -> float:
    return random.uniform(2e-3, 8e-3)


def asymmetric(random: Random, back: bool) -> float:
    return 2e-3 + random.expovariate(1 / (3e-3 if back else 0.5e-3))


def wifi(random: Random, back: bool) -> float:
    burst = random.uniform(5e-3, 40e-3) if random.random() < 0.2 else 0.0
    return 1e-3 + random.expovariate(1 / 1e-3) + burst


class Quartz:
    """A clock with an offset, a drift that wanders, and steps.

    `swing`: amplitude of the drift's change by temperature, and its period in s.
    """

    def __init__(
        self, random: Random, offset_s: float, drift: float, swing: tuple[float, float] = (0.0, 60.0)
    ) -> None:
        self._random = random
        self._drift = drift
        self._swing = swing
        self._true_s = 0.0
        self._offset_s = offset_s

    def read_ns(self, true_s: float) -> int:
        return round((true_s + self._offset_s + self._drift * (true_s - self._true_s)) * 1e9)

    def wander_to(self, true_s: float) -> None:
        self._offset_s += self._drift * (true_s - self._true_s)
        amplitude, period_s = self._swing
        turn = math.tau / period_s
        self._offset_s += amplitude / turn * (math.cos(turn * self._true_s) - math.cos(turn * true_s))
        self._drift += self._random.gauss(0, WANDER) * math.sqrt(true_s - self._true_s)
        self._true_s = true_s

    def step(self, by_s: float) -> None:
        self._offset_s += by_s


def whole_us(stamp_ns: int) -> int:
    return stamp_ns // 1000 * 1000


class Result(NamedTuple):
    """Result of one run: true time, error in µs, and True within the bound, at each received packet."""

    errors: list[tuple[float, float, bool]]
    first_s: float
    peer: ClockEstimator
    here: "Quartz"
    there: "Quartz"

    def percentile_us(self, ratio: float, after_s: float) -> float:
        errors = sorted(error for at_s, error, _ in self.errors if at_s >= after_s)
        return errors[int(ratio * len(errors))]

    def covered_ratio(self) -> float:
        return sum(inside for *_, inside in self.errors) / len(self.errors)

    def last_above_s(self, limit_us: float) -> float:
        return max((at_s for at_s, error, _ in self.errors if error > limit_us), default=0.0)


def simulate(
    delay: Delay,
    seed: int,
    *,
    length_s: float,
    step_at_s: float = math.inf,
    step_s: float = 0.0,
    pause_s: float = PAUSE_S,
    swing: tuple[float, float] = (0.0, 60.0),
    period_s: float = 0.1,
    echo_s: float = 0.0,
) -> Result:
    """Two units that tick at 10 Hz, each packet with the echo of the newest one heard, 5 % lost.

    `echo_s`: least time between two echoes, as in a cell of many.
    """
    random = Random(seed)
    here = Quartz(random, random.uniform(-100, 100), random.uniform(-50e-6, 50e-6))
    there = Quartz(random, random.uniform(-100, 100), random.uniform(-50e-6, 50e-6), swing)
    peer = ClockEstimator("there", "main", 2, 1, window_s=60, pause_s=pause_s, conv_epoch=0)
    heard_there: tuple[int, int] | None = None
    """(their view) our send time, their receive time."""
    errors: list[tuple[float, float, bool]] = []
    first_s, echo_due_s = math.inf, 0.0
    order = 0
    events: list[tuple[float, int, str, tuple[int, ...]]] = []

    def later(at_s: float, what: str, data: tuple[int, ...] = ()) -> None:
        nonlocal order
        order += 1
        heapq.heappush(events, (at_s, order, what, data))

    for tick in range(int(length_s / period_s)):
        later((tick + random.uniform(0, 0.1)) * period_s, "send")
        later((tick + random.uniform(0, 1.0)) * period_s, "answer")
        later(tick * period_s, "wander")
    if step_at_s < length_s:
        later(step_at_s, "step")
    while events:
        now_s, _, what, data = heapq.heappop(events)
        if what == "wander":
            here.wander_to(now_s)
            there.wander_to(now_s)
        elif what == "step":
            there.step(step_s)
        elif what == "send" and random.random() > 0.05:
            later(now_s + delay(random, False), "at there", (whole_us(here.read_ns(now_s)),))
        elif what == "at there":
            heard_there = (data[0], whole_us(there.read_ns(now_s)))
        elif what == "answer" and random.random() > 0.05:
            echo: tuple[int, ...] = ()
            if heard_there is not None and now_s >= echo_due_s:
                echo, echo_due_s = heard_there, now_s + echo_s
            later(now_s + delay(random, True), "at here", (whole_us(there.read_ns(now_s)), *echo))
        elif what == "at here":
            now_ns = here.read_ns(now_s)
            received_ns = whole_us(now_ns)
            sent_ns, most_ns = (data[1], data[2] - data[1]) if len(data) == 3 else (0, None)
            peer.on_exchange(Exchange(received_ns, data[0] - received_ns, sent_ns, most_ns))
            due_ns = peer.due_ns()
            if due_ns is not None and due_ns <= received_ns:
                peer.solve(received_ns)
            if peer.conversion is not None:
                first_s = min(first_s, now_s)
                error_ns = abs(peer.conversion.to_remote(now_ns) - there.read_ns(now_s))
                errors.append((now_s, error_ns / 1e3, error_ns <= peer.conversion.bound_at_ns(now_ns)))
    return Result(errors, first_s, peer, here, there)


class Node:
    """A clock, the core that measures other clocks with it, and the list that the core published last."""

    def __init__(self, name: str, hardware: int, random: Random) -> None:
        self.name = name
        self.hardware = hardware
        self.quartz = Quartz(random, random.uniform(-100, 100), random.uniform(-50e-6, 50e-6))
        self.core = TimeCore(name, "main", hardware, 1, Config(), first_epoch=0)
        self.board = TimeFunctions(name, "main", 1, 0)
