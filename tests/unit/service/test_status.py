"""The status board of a service: identity, state, and load of its process."""

import os
import resource
from pathlib import Path

import pytest

from swarmware.module.module import Module
from swarmware.service.status import Load, Reporter
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.system import AppStatus


def load(at_s: float, cpu_s: float, resident_bytes: int = 50_000_000) -> Load:
    return Load(at_s, cpu_s, resident_bytes)


async def test_first_report_is_there_when_it_is_opened(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("my-planner", node=node) as m:
        Reporter.open(m, 3)
        status = m.reader("app/my_planner/status", AppStatus).value
        assert status is not None, "a hyphen of the name is an underscore in the path"
        assert (status.pid, status.state, status.beat, status.restarts) == (os.getpid(), "starting", 1, 3)
        assert m.entry.name == "my-planner"


@pytest.mark.parametrize(
    ("before", "now", "percent", "megabytes"),
    [
        (load(10.0, 1.0), load(11.0, 1.25), 25.0, 50.0),
        (load(10.0, 1.0), load(12.0, 4.0), 150.0, 50.0),
        (load(10.0, 1.0), load(11.0, 1.0, 123_456_789), 0.0, 123.5),
        (load(10.0, 1.0), load(10.0, 1.0), 0.0, 50.0),
    ],
)
async def test_the_load_is_that_between_two_reports(
    tmp_path: Path, before: Load, now: Load, percent: float, megabytes: float
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        reporter, reader = Reporter.open(m, 0), m.reader("app/planner/status", AppStatus)
        reporter.report(load=before)
        reporter.report(load=now)
        status = reader.value
        assert status is not None
        assert (status.cpu_percent, status.rss_mb) == (percent, megabytes)


@pytest.mark.parametrize(
    ("loop_s", "tickers_s", "worst_s"), [(0.02, 0.0, 0.02), (0.02, 0.07, 0.07), (0.0, 0.0, 0.0)]
)
async def test_lateness_is_worst_of_process_and_tickers(
    tmp_path: Path, loop_s: float, tickers_s: float, worst_s: float
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        reporter, reader = Reporter.open(m, 0), m.reader("app/planner/status", AppStatus)
        m.lateness.note(round(tickers_s * 1e9))
        assert reporter.beat(loop_s, load(1.0, 1.0)) == worst_s
        status = reader.value
        assert status is not None
        assert status.loop_lag_ms == pytest.approx(worst_s * 1000)
        assert status.beat == 2
        assert reporter.beat(0.0, load(2.0, 1.0)) == 0.0


def test_the_load_of_this_process_is_measured() -> None:
    first, second = Load.measured(), Load.measured()
    assert second.at_s >= first.at_s
    assert second.cpu_s >= first.cpu_s
    assert 1_000_000 < first.resident_bytes < 10_000_000_000


def test_process_without_descriptors_measures_load_without_memory() -> None:
    assert Load.measured().resident_bytes > 0
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (0, hard))
        load = Load.measured()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert load.resident_bytes == 0
    assert load.cpu_s > 0
