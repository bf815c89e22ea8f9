"""Too many nodes for the processor: refused by what the first ones use at rest, before the others start."""

import os

import pytest

from swarmctl.session.labs import LabState
from swarmctl.session.processes import identity
from swarmlab.measure import host, load
from swarmlab.measure.host import HostInfo
from swarmlab.run import capacity
from swarmware.errors import SwarmError


def measured(nodes_percent: float, cores: int = 2) -> HostInfo:
    return HostInfo("Some CPU", cores, "6.1", 0.5, nodes_percent, 12.0)


@pytest.mark.parametrize(
    ("nodes", "cores", "needed"),
    [(16, 2, False), (17, 2, True), (32, 2, True), (32, 4, False), (3, 1, False)],
)
def test_uncertain_lab_is_measured(nodes: int, cores: int, needed: bool) -> None:
    assert capacity.needs_measurement(nodes, cores) is needed


def test_use_of_first_nodes_must_scale() -> None:
    assert capacity.refusal(32, measured(8 * 6.2), 8) == ""
    reason = capacity.refusal(32, measured(8 * 12.0), 8)
    for figure in ("32 nodes are too many", "first 8 use 12.0 %", "2 cores (Some CPU)", "at most 16 nodes"):
        assert figure in reason


def test_full_processor_of_running_nodes_is_warning() -> None:
    assert capacity.shortage(32, measured(180.0)) == ""
    assert "short for 32 nodes, 2 cores (Some CPU)" in capacity.shortage(32, measured(195.2))
    assert capacity.shortage(32, measured(195.2, cores=4)) == ""


@pytest.mark.parametrize(("shares", "fits"), [([12.0, 9.0, 6.0], True), ([9.0] * capacity.SAMPLES, False)])
async def test_joining_load_does_not_refuse_lab(
    monkeypatch: pytest.MonkeyPatch, shares: list[float], fits: bool
) -> None:
    left = iter(shares)
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr(capacity, "SAMPLE_S", 0.0)
    monkeypatch.setattr(load, "usage", lambda _: {})
    monkeypatch.setattr(host, "shares", lambda *_: measured(8 * next(left)))
    lab = LabState(
        name="large",
        experiment="formation",
        net="loopback",
        seed=1,
        folder="/",
        created_utc_ns=0,
        starter=identity(os.getpid()),
        multicast_group="",
        udp_port=0,
        nodes=(),
    )
    if fits:
        await capacity.Capacity(32).check_first(lab)
    else:
        with pytest.raises(SwarmError, match="lab large: 32 nodes are too many"):
            await capacity.Capacity(32).check_first(lab)
    assert next(left, None) is None, "as many samples as it takes"


def test_only_doubtful_lab_starts_in_two_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    assert capacity.Capacity(16).first == 16
    assert capacity.Capacity(32).first == capacity.FIRST
