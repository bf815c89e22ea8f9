"""Too many nodes for the processor: said from what the first ones use, before the others are started."""

import pytest

from swarmlab.measure.host import HostInfo
from swarmlab.run import capacity


def measured(nodes_percent: float, cores: int = 2) -> HostInfo:
    return HostInfo("Some CPU", cores, "6.1", 0.5, nodes_percent, 12.0)


@pytest.mark.parametrize(
    ("nodes", "cores", "needed"),
    [(16, 2, False), (17, 2, True), (32, 2, True), (32, 4, False), (3, 1, False)],
)
def test_a_lab_is_measured_where_it_is_not_certain_that_it_fits(nodes: int, cores: int, needed: bool) -> None:
    assert capacity.needs_measurement(nodes, cores) is needed


def test_what_the_first_nodes_use_must_fit_for_all_of_them() -> None:
    assert capacity.refusal(32, measured(8 * 5.5), 8) == ""
    reason = capacity.refusal(32, measured(8 * 12.0), 8)
    for figure in ("32 nodes are too many", "first 8 use 12.0 %", "2 cores (Some CPU)", "at most 15 nodes"):
        assert figure in reason


def test_when_all_are_up_what_they_use_together_counts() -> None:
    assert capacity.refusal(32, measured(180.0), 32) == ""
    assert "the 32 use 6.1 % of a core each" in capacity.refusal(32, measured(195.2), 32)
    assert capacity.refusal(32, measured(195.2, cores=4), 32) == ""


def test_only_a_lab_that_may_not_fit_is_started_in_two_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    assert capacity.Capacity(16).first == 16
    assert capacity.Capacity(32).first == capacity.FIRST
