"""Expired commands in virtual time: clocks that drift and step, and links that lose or are cut."""

from typing import Final

import pytest
from tests.simulation.directory.brokers import BrokerNode

from swarmware.model.frame import Frame, FrameKind
from swarmware.model.names import hardware_id
from swarmware.testing.virtual import VirtualClock, VirtualSwarm
from swarmware.transport.delivery.answer import expired, with_lifetime

SECOND: Final = 1_000_000_000
DELAY_S: Final = 0.06
"""Maximum delay of a beacon."""
RATE: Final = 0.0031
"""By which the bound may fall behind while no beacon arrives: 2000 ppm, and two clocks of ±500 ppm."""
PROBE_S: Final = 0.1
LIFE_S: Final = 1.0


class Pair:
    """A sender and a receiver of commands, each with a clock of its own."""

    def __init__(self, seed: int, *, loss: float, offset_s: float, drift_ppm: float) -> None:
        self.net: VirtualSwarm[str] = VirtualSwarm(seed, loss=loss, delay_s=(0.0, DELAY_S))
        self.sender = self.started(1, offset_s, drift_ppm)
        self.receiver = BrokerNode(self.net, "uav1", VirtualClock(self.net, 0.0, -drift_ppm))
        self.late_ns: list[int] = []
        """How far the bound was behind the clock of the sender, at each probe."""
        self.silent_s = 0.0
        self.checked = True
        """Not while the receiver has the former clock of the sender."""
        self._received = 0
        self.net.every(PROBE_S, self.probe)

    def started(self, session: int, offset_s: float, drift_ppm: float) -> BrokerNode:
        return BrokerNode(self.net, "gcs", VirtualClock(self.net, offset_s, drift_ppm), session=session)

    def bound_ns(self) -> int | None:
        return self.receiver.core.clock_bound_ns(hardware_id("gcs"), self.receiver.clock.now_ns())

    def refuses(self, age_s: float) -> bool | None:
        """Whether a command of this age is refused as expired, or None if its age is not known."""
        bound_ns = self.bound_ns()
        stamp_ns = self.sender.clock.now_ns() - round(age_s * 1e9)
        frame = Frame(FrameKind.MESSAGE, 1, stamp_ns=stamp_ns, extension=with_lifetime(LIFE_S))
        return None if bound_ns is None else expired(frame, bound_ns)

    def probe(self) -> None:
        received = self.receiver.core.counters.received_datagrams
        self.silent_s = 0.0 if received > self._received else self.silent_s + PROBE_S
        self._received = received
        bound_ns = self.bound_ns()
        if bound_ns is None or not self.checked:
            return
        late_ns = self.sender.clock.now_ns() - bound_ns
        self.late_ns.append(late_ns)
        assert late_ns >= 0, "no command is refused before its end"
        behind_ns = (DELAY_S + PROBE_S + RATE * (self.silent_s + PROBE_S)) * 1e9
        assert late_ns <= behind_ns, "none is accepted longer than its beacon took"


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("drift_ppm", [-500.0, 0.0, 500.0])
@pytest.mark.parametrize("offset_s", [-3600.0, 0.0, 86_400.0])
def test_drifting_clocks_do_not_change_command_lifetime(seed: int, drift_ppm: float, offset_s: float) -> None:
    pair = Pair(seed, loss=0.3, offset_s=90_000.0 + offset_s, drift_ppm=drift_ppm)
    pair.net.run_for(60)
    assert len(pair.late_ns) > 500
    assert pair.refuses(LIFE_S + 2 * DELAY_S + 2 * PROBE_S) is True
    assert pair.refuses(LIFE_S - 0.01) is False


@pytest.mark.parametrize("seed", range(4))
def test_minute_without_beacons_lengthens_lifetime_by_clock_rates(seed: int) -> None:
    pair = Pair(seed, loss=0.0, offset_s=1000.0, drift_ppm=500.0)
    pair.net.run_for(5)
    pair.net.link = lambda _a, _b: False
    pair.net.run_for(60)
    assert pair.silent_s > 55
    assert max(pair.late_ns) < 0.35 * SECOND
    assert pair.refuses(LIFE_S - 0.01) is False
    assert pair.refuses(LIFE_S + 0.4) is True, "a queue that was stuck for a minute brings nothing old"


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("step_s", [-5000.0, 5000.0])
def test_clock_step_shows_in_senders_next_beacon(seed: int, step_s: float) -> None:
    pair = Pair(seed, loss=0.1, offset_s=10_000.0, drift_ppm=200.0)
    pair.net.run_for(5)
    assert pair.refuses(0.0) is False
    pair.sender.stop()  # its computer starts again, and its clock begins somewhere else
    pair.net.run_for(20)
    pair.checked = False
    pair.sender = pair.started(2, 10_000.0 + step_s, 200.0)
    for _ in range(300):
        bound_ns = pair.bound_ns()
        if bound_ns is not None and abs(bound_ns - pair.sender.clock.now_ns()) < SECOND:
            break
        assert step_s > 0 or pair.refuses(0.0) is not False, "its clock seems to be far before its commands"
        pair.net.run_for(0.01)
    else:
        pytest.fail("its clock is not known within three seconds")
    pair.checked = True
    pair.net.run_for(10)
    assert pair.refuses(0.0) is False
    assert pair.refuses(LIFE_S + 2 * DELAY_S + 2 * PROBE_S) is True
