"""The computer beside a run's figures: what it is, and who used it."""

from pathlib import Path

import pytest

from swarmlab.measure import host
from swarmlab.measure.host import CpuTime, HostInfo


def test_computer_is_described_and_processor_time_rises() -> None:
    here = host.describe()
    assert here.processor
    assert here.cores >= 1
    assert here.load_before is not None
    before = host.busy()
    sum(range(2_000_000))
    assert host.busy().cpu_s >= before.cpu_s


def test_processor_time_beyond_nodes_belongs_to_others() -> None:
    found = host.shares(HostInfo(cores=2), CpuTime(10, 100), CpuTime(20, 115), [40.0, 60.0])
    assert found.nodes_percent == pytest.approx(100)
    assert found.others_percent == pytest.approx(50)
    assert host.shares(HostInfo(cores=2), CpuTime(10, 100), CpuTime(10, 100), [1.0]) == HostInfo(cores=2)
    some = host.shares(HostInfo(cores=2), CpuTime(10, 100), CpuTime(20, 115), [40.0, None])
    assert some == HostInfo(cores=2), "what others used cannot be known without all nodes"


def test_a_missed_goal_is_read_beside_the_load() -> None:
    shown = HostInfo("Some CPU", 2, "6.1", 10.24, 120.4, 55.5).summary()
    for figure in ("2 cores (Some CPU)", "load 10.2", "nodes used 120 %", "other processes 56 %"):
        assert figure in shown
    assert host.HostInfo("Some CPU", 2).summary() == "2 cores (Some CPU)"


def test_kernel_without_model_name_gives_architecture(tmp_path: Path) -> None:
    (tmp_path / "cpuinfo").write_text("processor\t: 0\nmodel name\t: An ARM\n")
    assert host.processor(tmp_path / "cpuinfo") == "An ARM"
    (tmp_path / "cpuinfo").write_text("processor\t: 0\n")
    assert host.processor(tmp_path / "cpuinfo") == host.processor(tmp_path / "absent") != ""
