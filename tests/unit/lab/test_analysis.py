"""From logs to figures: a made-up run of three nodes, every figure of which is known beforehand."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from swarmlab.measure import clocks, traffic_totals
from swarmlab.measure.clocks import ClockTruth
from swarmlab.measure.host import HostInfo
from swarmlab.report import analysis
from swarmlab.report.plot_data import PlotData
from swarmlab.report.report import ExperimentReport, MeanMax
from swarmlab.report.run_metadata import NodeMetadata, RunMetadata
from swarmlab.run.notify import Restarts
from swarmware.model.platform_kind import PlatformKind
from swarmware.recorder.segment import LogChannel, SegmentWriter
from swarmware.types import registry
from swarmware.types.log import GapCause, LogGap
from swarmware.types.mission import BarrierResult, MissionPhase, MissionProgress, MissionState, OrderReceipt
from swarmware.types.net import LinkTraffic, LinkTransport, Refused, Traffic
from swarmware.types.time import Conversion, TimeFunctions
from swarmware.types.vehicle import Collision, Goal, GoalKind, Pose

ORIGIN_NS = 7_000_000_000_000
CLOCKS = {"gcs": ClockTruth(2.0, 10.0), "ugv1": ClockTruth(-4.0, -30.0), "uav1": ClockTruth(0.5, 45.0)}
KINDS = {"gcs": "gcs", "ugv1": "ugv", "uav1": "uav"}
END_S = 20.0
COURSE = ((-100.0, 40.0), (100.0, 40.0))
SLOT = (-3.0, 0.0, 8.0)


def stamp(platform: str, t_s: float) -> int:
    return CLOCKS[platform].clock.from_mono_ns(ORIGIN_NS + round(t_s * 1e9))


class Log:
    """One node's log being made up."""

    def __init__(self, logs: Path, platform: str) -> None:
        (logs / platform).mkdir(parents=True)
        self.platform = platform
        self._writer = SegmentWriter(logs / platform / "000001.mcap", {})
        self._sequence = 0

    def add(self, path: str, t_s: float, value: msgspec.Struct) -> None:
        self._sequence += 1
        channel = LogChannel(self.platform, path, "board", type(value).__name__, f"{self.platform}:x:out")
        at_ns = stamp(self.platform, t_s)
        self._writer.append(channel, self._sequence, at_ns, self._sequence, registry.encode(value))

    def close(self) -> None:
        self._writer.close()


def traffic(platform: str, t_s: float) -> Traffic:
    """1 kB/s sent and 2 kB/s received from the node's start at -10 s on, a request a second, 20 values."""
    up_s = t_s + 10
    return Traffic(
        since_ns=stamp(platform, -10),
        at_ns=stamp(platform, t_s),
        sent_bytes=round(1000 * up_s),
        received_bytes=round(2000 * up_s),
        udp_sent_bytes=0,
        udp_received_bytes=0,
        tcp_sent_bytes=0,
        tcp_received_bytes=0,
        sent_datagrams=0,
        received_datagrams=0,
        lost_datagrams=1 if t_s > 10 else 0,
        sent_frames=0,
        received_frames=0,
        forwarded_frames=0,
        requests=round(up_s),
        notifications=round(20 * up_s),
        tick_hz=10,
        refused=Refused(),
        links=(
            LinkTraffic(
                "gcs" if platform != "gcs" else "uav1", LinkTransport.UDP, received_frames=99, lost=1
            ),
        ),
    )


def functions(platform: str, t_s: float, error_us: float) -> TimeFunctions:
    """Conversions of the other two, each wrong by so much."""
    now_ns = stamp(platform, t_s)
    made = tuple(
        Conversion(
            platform=other,
            unit="main",
            hardware=1,
            boot_id=1,
            offset_ns=stamp(other, t_s) - now_ns + round(error_us * 1000),
            skew=0.0,
            t0_ns=now_ns,
            bound_ns=1,
            sigma_ns=1,
            skew_bound=0.0,
            conv_epoch=0,
            samples=9,
            rtt_ns=300_000,
        )
        for other in CLOCKS
        if other != platform
    )
    return TimeFunctions(platform, "main", 1, now_ns, made)


def write_logs(logs: Path) -> None:
    for platform in CLOCKS:
        log = Log(logs, platform)
        for tick in range(-20, 221):
            t_s = tick / 10
            if platform != "gcs":
                # the leader drives east on the course, the follower above its slot, 0.25 m beside it
                x_m = t_s if platform == "ugv1" else t_s + SLOT[0]
                y_m, z_m = (40.0, 0.0) if platform == "ugv1" else (40.25, SLOT[2])
                log.add("sim/truth", t_s, Pose(x_m, y_m, z_m))
            if tick % 10 == 0:
                log.add("net/traffic", t_s, traffic(platform, t_s))
                log.add("time/functions", t_s, functions(platform, t_s, 10.0 if platform == "gcs" else -40.0))
        if platform != "gcs":
            goal = Goal(1, GoalKind.FORMATION, leader="ugv1", course=COURSE)
            offset = (0.0, 0.0, 0.0) if platform == "ugv1" else SLOT
            log.add("nav/goal", 1.0, msgspec.structs.replace(goal, offset_m=offset))
            log.add("nav/goal", 5.0, msgspec.structs.replace(goal, seq=2, offset_m=offset, advance=True))
            log.add("nav/goal", 18.0, Goal(3, GoalKind.LAND))
            ended = MissionProgress("formation", 77, "", "Mission", "state:done", 0)
            log.add("mission/progress", END_S if platform == "uav1" else 19.0, ended)
        log.close()


def facts() -> RunMetadata:
    orders = tuple(
        OrderReceipt(
            "formation", 77, p, "r", stamp("gcs", left_s), stamp("gcs", 0.009), stamp(p, left_s + 0.002), True
        )
        for p, left_s in (("ugv1", 0.001), ("uav1", 0.005))
    )
    return RunMetadata(
        experiment="formation",
        world="formation",
        seed=1,
        net="loopback",
        version="0",
        host=HostInfo("Some CPU", 2),
        started_utc_ns=0,
        ready_s=4.5,
        command_mono_ns=ORIGIN_NS,
        instructed_ns=stamp("gcs", -0.001),
        end_mono_ns=ORIGIN_NS + 21_000_000_000,
        completed=True,
        orders=orders,
        nodes=tuple(
            NodeMetadata(
                platform=p,
                kind=PlatformKind(KINDS[p]),
                radius_m=0.0 if p == "gcs" else 0.3,
                clock=truth,
                processes="one",
                outcome="done",
                cpu_percent=4.0 + i,
                rss_mb=70.0 + i,
            )
            for i, (p, truth) in enumerate(CLOCKS.items())
        ),
    )


@pytest.fixture
def result(tmp_path: Path) -> tuple[ExperimentReport, PlotData]:
    write_logs(tmp_path)
    return analysis.analyse(facts(), tmp_path)


def test_every_figure_of_the_made_up_run_is_found(result: tuple[ExperimentReport, PlotData]) -> None:
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


def test_the_scene_shows_what_happened_between_command_and_end(
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


def test_blocks_barriers_and_known_links_are_taken_from_the_logs(tmp_path: Path) -> None:
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


def test_counters_that_fell_back_are_added_up_over_the_restart() -> None:
    def at(t_s: float, sent: int) -> tuple[float, Traffic]:
        return t_s, msgspec.structs.replace(traffic("gcs", 0), sent_bytes=sent, requests=0)

    counters = [at(0, 1000), at(1, 2000), at(2, 500), at(3, 1500)]
    assert traffic_totals.between(counters, 0, 3).sent_bytes == 2500
    assert traffic_totals.between([], 0, 3) == traffic_totals.TrafficTotals()
    assert traffic_totals.egress(counters[:1]).t_s.size == 0
    assert traffic_totals.egress(counters).value == pytest.approx([1.0, 0.5, 1.0])


def test_a_conversion_nobody_measured_and_one_of_a_stranger_have_no_error() -> None:
    published = functions("gcs", 3.0, 25.0)
    assert clocks.errors_us("gcs", [published], CLOCKS) == pytest.approx([25.0, 25.0], abs=0.01)
    first, second = published.functions
    unknown = msgspec.structs.replace(first, samples=0), msgspec.structs.replace(second, platform="usv9")
    assert clocks.errors_us("gcs", [msgspec.structs.replace(published, functions=unknown)], CLOCKS) == []


def test_a_mission_that_did_not_end_everywhere_lasts_until_the_run_was_broken_off(tmp_path: Path) -> None:
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
