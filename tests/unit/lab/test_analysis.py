"""From logs to figures: a made-up run of three nodes, every figure of which is known beforehand."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from tests.unit.lab.logs import (
    CLOCKS,
    COURSE,
    END_S,
    Log,
    facts,
    functions,
    stamp,
    traffic,
    write_logs,
)

from swarmlab.measure import clocks, traffic_totals
from swarmlab.measure.host import HostInfo
from swarmlab.report import analysis
from swarmlab.report.plot_data import PlotData
from swarmlab.report.report import ExperimentReport, MeanMax
from swarmlab.run.notify import Restarts
from swarmware.types.log import GapCause, LogGap
from swarmware.types.mission import BarrierResult, MissionPhase, MissionProgress, MissionState
from swarmware.types.navigation import Collision
from swarmware.types.net import LinkTransport
from swarmware.types.traffic import LinkTraffic, Traffic


@pytest.fixture
def result(tmp_path: Path) -> tuple[ExperimentReport, PlotData]:
    write_logs(tmp_path)
    return analysis.analyse(facts(), tmp_path)


def test_every_figure_of_made_up_run_is_found(result: tuple[ExperimentReport, PlotData]) -> None:
    found, _ = result
    assert found.nodes == 3
    assert found.ready_s == 4.5
    assert found.completed
    assert found.duration_s == pytest.approx(END_S)
    assert found.traffic.global_kbps == pytest.approx(3.0, rel=1e-3)
    assert found.traffic.egress_kbps == pytest.approx(1.0, rel=1e-3)
    assert found.traffic.ingress_kbps == pytest.approx(2.0, rel=1e-3)
    assert found.requests == 60
    assert found.notifications == 1200
    assert found.bytes_per_notification == pytest.approx(100, rel=1e-3)
    # the instruction came 1 ms before the command's zero, the orders left 1 ms and 5 ms after it
    assert found.command_to_receipt_ms.p50 == pytest.approx(6.0, abs=1e-3)
    assert found.command_to_receipt_ms.max == pytest.approx(8.0, abs=1e-3)
    assert found.order_to_receipt_ms.p50 == pytest.approx(2.0, abs=1e-3)
    assert found.order_to_receipt_ms.max == pytest.approx(2.0, abs=1e-3)
    assert found.last_answer_ms == pytest.approx(10.0, abs=1e-3)
    assert [receipt.platform for receipt in found.receipts] == ["uav1", "ugv1"]
    assert found.host == HostInfo("Some CPU", 2)
    assert found.formation_error_m.mean == pytest.approx(0.25, abs=1e-6)
    assert found.formation_error_m.max == pytest.approx(0.25, abs=1e-6)
    assert found.min_separation_m == pytest.approx(np.hypot(np.hypot(3, 8), 0.25))
    assert found.collisions == 0
    assert found.frames_lost == 3
    assert found.log_frames == 2 * (241 + 4) + 3 * 2 * 25
    assert found.log_gaps == 0
    # two of three nodes are 40 µs off, the third 10 µs
    assert found.clock_error_us.p95 == pytest.approx(40.0, abs=0.1)
    assert found.cpu_percent_of_core == MeanMax(5.0, 6.0)
    assert found.rss_mb == MeanMax(71.0, 72.0)


def test_scene_shows_what_happened_between_command_and_end(
    result: tuple[ExperimentReport, PlotData],
) -> None:
    _, scene = result
    assert scene.leader == "ugv1"
    assert scene.course == COURSE
    assert [(round(a, 6), round(b, 6)) for a, b in scene.formed] == [(5.0, 18.0)]
    assert set(scene.tracks) == {"ugv1", "uav1"}
    assert all(track.t_s.min() >= 0 and track.t_s.max() <= END_S for track in scene.tracks.values())
    assert set(scene.formation_errors) == {"uav1"}
    assert scene.traffic["gcs"].value == pytest.approx(np.ones(len(scene.traffic["gcs"].t_s)), rel=1e-3)
    assert [(n.node, n.hears, n.quality) for n in scene.neighbours] == [
        ("gcs", "uav1", 0.99),
        ("uav1", "gcs", 0.99),
        ("ugv1", "gcs", 0.99),
    ]
    assert [n.rtt_ms for n in scene.neighbours] == pytest.approx([0.3, 0.3, 0.3])
    assert len(scene.obstacles) > 3, "the world of the experiment"


def test_collisions_and_gaps_are_counted(tmp_path: Path) -> None:
    write_logs(tmp_path)
    log = Log(tmp_path, "ugv1/more")
    log.platform = "ugv1"
    log.add("sim/collision", 7.0, Collision("boulder_right", 0, 0, 0, 1))
    log.add("sim/collision", 7.4, Collision("boulder_right", 0, 0, 0, 1))
    log.add("sim/collision", 30.0, Collision("boulder_left", 0, 0, 0, 1))
    log.add("log/gaps", 8.0, LogGap(GapCause.RING, "q", "sim/truth", 12))
    log.close()
    (tmp_path / "ugv1" / "more" / "000001.mcap").rename(tmp_path / "ugv1" / "000002.mcap")
    found, _ = analysis.analyse(facts(), tmp_path)
    assert found.collisions == 1, "grinding is one; what comes after the mission is not its"
    assert found.log_gaps == 12


def test_blocks_barriers_and_links_come_from_logs(tmp_path: Path) -> None:
    write_logs(tmp_path)
    log = Log(tmp_path, "ugv1/more")
    log.platform = "ugv1"
    log.add("mission/progress", 2.0, MissionProgress("formation", 77, "form", "Formation", "started", 0))
    log.add("mission/progress", 6.0, MissionProgress("formation", 77, "form", "Formation", "ok", 0))
    meetings = (BarrierResult("formed", 1, stamp("ugv1", 6.5)),)
    log.add("mission/state", 6.4, MissionState(77, "", MissionPhase.RUNNING, meetings=meetings))
    other = (BarrierResult("earlier", 1, stamp("ugv1", 1.5)),)
    log.add("mission/state", 1.0, MissionState(76, "", MissionPhase.RUNNING, meetings=other))
    unknown = LinkTraffic("?", LinkTransport.UDP, received_frames=9, lost=0)
    newest = traffic("ugv1", 22.5)
    log.add("net/traffic", 22.5, msgspec.structs.replace(newest, links=(*newest.links, unknown)))
    log.close()
    (tmp_path / "ugv1" / "more" / "000001.mcap").rename(tmp_path / "ugv1" / "000002.mcap")
    _, scene = analysis.analyse(facts(), tmp_path)
    assert [(s.block, round(s.start_s, 6), round(s.end_s, 6)) for s in scene.timelines["ugv1"].spans] == [
        ("form", 2.0, 6.0)
    ]
    assert [(b.barrier, round(b.at_s, 6), b.members) for b in scene.barriers] == [("formed", 6.5, 1)]
    assert {link.hears for link in scene.neighbours} == {"gcs", "uav1"}, "not of an unknown sender"
    assert scene.unaccepted == 9
    assert [node.platform for node in scene.nodes] == ["gcs", "uav1", "ugv1"]


def test_a_run_that_never_moved_has_figures_too(tmp_path: Path) -> None:
    for platform in CLOCKS:
        Log(tmp_path, platform).close()
    found, _ = analysis.analyse(msgspec.structs.replace(facts(), completed=False, orders=()), tmp_path)
    assert found.notifications == found.requests == found.collisions == 0
    assert found.bytes_per_notification is None
    assert found.min_separation_m is None
    assert found.formation_error_m == MeanMax()
    assert found.duration_s == pytest.approx(21.0)


def test_reset_counters_are_summed_over_restart() -> None:
    def at(t_s: float, sent: int) -> tuple[float, Traffic]:
        return t_s, msgspec.structs.replace(traffic("gcs", 0), sent_bytes=sent, requests=0)

    counters = [at(0, 1000), at(1, 2000), at(2, 500), at(3, 1500)]
    assert traffic_totals.between(counters, 0, 3).sent_bytes == 2500
    assert traffic_totals.between([], 0, 3) == traffic_totals.TrafficTotals()
    assert traffic_totals.egress(counters[:1]).t_s.size == 0
    assert traffic_totals.egress(counters).value == pytest.approx([1.0, 0.5, 1.0])


def test_unmeasured_or_foreign_conversion_has_no_error() -> None:
    published = functions("gcs", 3.0, 25.0)
    assert clocks.errors_us("gcs", [published], CLOCKS) == pytest.approx([25.0, 25.0], abs=0.01)
    first, second = published.functions
    unknown = msgspec.structs.replace(first, samples=0), msgspec.structs.replace(second, platform="usv9")
    assert clocks.errors_us("gcs", [msgspec.structs.replace(published, functions=unknown)], CLOCKS) == []


def test_unfinished_mission_lasts_until_end_of_run(tmp_path: Path) -> None:
    write_logs(tmp_path)
    died = tmp_path / "uav1" / "000001.mcap"
    died.unlink()
    log = Log(tmp_path / "x", "uav1")
    log.add("mission/progress", 2.0, MissionProgress("formation", 77, "", "Mission", "state:running", 0))
    log.close()
    (tmp_path / "x" / "uav1" / "000001.mcap").rename(died)
    nodes = tuple(
        msgspec.structs.replace(node, ended="signal 9", restarts=Restarts(2), cpu_percent=None, rss_mb=None)
        if node.platform == "uav1"
        else node
        for node in facts().nodes
    )
    broken_off = msgspec.structs.replace(facts(), completed=False, failure="node uav1: ended", nodes=nodes)
    found, scene = analysis.analyse(broken_off, tmp_path)
    assert found.duration_s == pytest.approx(21.0)
    (dead,) = [node for node in scene.nodes if node.platform == "uav1"]
    assert (dead.outcome, dead.restarts) == ("node ended: signal 9", 2)
