"""Estimator on simulated clocks and links: four models of delay, seeded, in virtual time."""

from itertools import pairwise
from random import Random

import pytest
from tests.simulation.timesync.clocks import (
    Delay,
    Node,
    asymmetric,
    lan,
    simulate,
    uniform,
    whole_us,
    wifi,
)

from swarmd.timesync.config import Config
from swarmd.timesync.core.peer import Exchange
from swarmd.timesync.core.time_core import PeerExchange, Publish, TimeCore
from swarmware.types.time import Conversion, TimeFunctions


@pytest.mark.parametrize(
    ("delay", "p99_us"),
    [(lan, 10), (asymmetric, 100), (uniform, 250), (wifi, 100)],
    ids=["lan", "asymmetric", "uniform 2-8 ms", "wifi bursts"],
)
def test_the_error_is_small_and_inside_its_bound(delay: Delay, p99_us: float) -> None:
    runs = [simulate(delay, seed, length_s=150) for seed in range(6)]
    settled = sorted(error for run in runs for at_s, error, _ in run.errors if at_s > 30)
    assert settled[int(0.99 * len(settled))] < p99_us
    covered = [inside for run in runs for *_, inside in run.errors]
    assert sum(covered) / len(covered) >= 0.999
    assert max(run.first_s for run in runs) < 1.0


@pytest.mark.parametrize("step_s", [5.0, -5.0, 0.02, -0.02])
@pytest.mark.parametrize("delay", [lan, uniform, wifi], ids=["lan", "uniform", "wifi"])
def test_a_clock_step_is_noticed_and_recovered_from(delay: Delay, step_s: float) -> None:
    for seed in range(3):
        run = simulate(delay, seed, length_s=45, step_at_s=30, step_s=step_s)
        assert run.peer.steps == 1, f"seed {seed}"
        assert run.peer.conversion is not None
        assert run.peer.conversion.conv_epoch == 1
        assert run.last_above_s(10_000) < 32.0, f"seed {seed}"


def test_step_too_small_to_be_impossible_still_fades() -> None:
    run = simulate(uniform, 1, length_s=120, step_at_s=30, step_s=0.003)
    assert run.percentile_us(0.99, after_s=95) < 250


@pytest.mark.parametrize(
    ("delay", "steps_s"),
    [
        (uniform, (0.002, -0.002, 0.003, 0.004)),
        (asymmetric, (-0.002, 0.003)),
        (wifi, (0.001, 0.0015, -0.002)),
    ],
    ids=["uniform 2-8 ms", "asymmetric", "wifi bursts"],
)
def test_bound_is_true_soon_after_small_clock_step(delay: Delay, steps_s: tuple[float, ...]) -> None:
    for step_s in steps_s:
        for seed in range(4):
            run = simulate(delay, seed, length_s=100, step_at_s=45, step_s=step_s)
            wrong_s = [at_s for at_s, _, inside in run.errors if not inside]
            assert all(45 <= at_s < 47.5 for at_s in wrong_s), f"{step_s * 1e3} ms, seed {seed}"


def test_no_run_without_a_step_sees_one() -> None:
    for delay in (lan, uniform, asymmetric, wifi):
        for seed in range(20, 26):
            assert simulate(delay, seed, length_s=40).peer.steps == 0, f"{delay.__name__} seed {seed}"


def test_unmet_units_convert_over_neighbours_within_summed_bounds() -> None:
    random = Random(5)
    chain = [Node(f"n{index}", index, random) for index in range(1, 7)]
    links = [*pairwise(chain), *pairwise(chain[::-1])]
    newest: dict[tuple[int, int], tuple[int, int]] = {}
    for tick in range(400):
        true_s = tick / 10
        for a, b in links:
            sent_ns = whole_us(b.quartz.read_ns(true_s))
            arrival_s = true_s + lan(random, False)
            received_ns = whole_us(a.quartz.read_ns(arrival_s))
            echo = newest.get((b.hardware, a.hardware))
            newest[a.hardware, b.hardware] = (sent_ns, received_ns)
            exchange = Exchange(
                received_ns,
                sent_ns - received_ns,
                echo[0] if echo else 0,
                echo[1] - echo[0] if echo else None,
            )
            a.core.on_exchange(PeerExchange(b.name, "main", b.hardware, 1, exchange), received_ns)
            for action in a.core.on_timer(received_ns):
                if isinstance(action, Publish):
                    a.board = action.functions
        if tick % 10 == 0:
            for a, b in links:
                a.core.on_functions(b.board, a.quartz.read_ns(true_s + 0.05))
        for node in chain:
            node.quartz.wander_to(true_s)
    first, last = chain[0], chain[-1]
    now_ns = first.quartz.read_ns(40.0)
    function = first.core.functions(now_ns).of(last.name)
    assert function is not None
    assert function.hops == 5
    assert function.via == chain[1].name
    error_ns = abs(function.to_remote(now_ns) - last.quartz.read_ns(40.0))
    assert error_ns < 200_000
    assert error_ns <= function.bound_at_ns(now_ns)
    assert not any(known.suspect for known in first.core.functions(now_ns).functions)


def test_lying_partner_is_marked_by_open_triangles() -> None:
    now_ns = 1_000_000_000_000

    def function(of: int, offset_ns: int) -> Conversion:
        return Conversion(f"n{of}", "main", of, 1, offset_ns, 0.0, now_ns, 50_000, 2_000, 1e-7, 0, samples=99)

    core = TimeCore("n1", "main", 1, 1, Config(), first_epoch=0)
    for of in (2, 3, 4):
        for _ in range(3):
            core.on_exchange(
                PeerExchange(f"n{of}", "main", of, 1, Exchange(now_ns, -50_000, now_ns, 50_000)), now_ns
            )
    core.on_timer(now_ns)
    honest = {2: {3: 0, 4: 9_000_000}, 3: {2: 0, 4: 9_000_000}}
    for teller, offsets in honest.items():
        told = tuple(function(of, offset_ns) for of, offset_ns in offsets.items())
        core.on_functions(TimeFunctions(f"n{teller}", "main", 1, now_ns, told), now_ns)
    marks = {known.platform: known.suspect for known in core.functions(now_ns).functions if known.hops == 1}
    assert marks == {"n2": False, "n3": False, "n4": True}


@pytest.mark.parametrize(
    ("delay", "p95_us"), [(lan, 50), (asymmetric, 300), (wifi, 300)], ids=["lan", "asymmetric", "wifi bursts"]
)
def test_two_packets_per_second_suffice_at_rest(delay: Delay, p95_us: float) -> None:
    runs = [simulate(delay, seed, length_s=150, period_s=0.5, echo_s=2.5) for seed in range(6)]
    settled = sorted(error for run in runs for at_s, error, _ in run.errors if at_s > 60)
    assert settled[int(0.95 * len(settled))] < p95_us
    assert all(inside for run in runs for *_, inside in run.errors)
