"""Logs of a formation flight, as the nodes of a lab would write them."""

from pathlib import Path

import msgspec

from swarmlab.measure.clocks import ClockTruth
from swarmlab.measure.host import HostInfo
from swarmlab.report.run_metadata import NodeMetadata, RunMetadata
from swarmware.model.platform_kind import PlatformKind
from swarmware.recorder.segment import LogChannel, SegmentWriter
from swarmware.types import registry
from swarmware.types.mission import MissionProgress, OrderReceipt
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.net import LinkTransport
from swarmware.types.time import Conversion, TimeFunctions
from swarmware.types.traffic import LinkTraffic, Refused, Traffic
from swarmware.types.vehicle import Pose

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
