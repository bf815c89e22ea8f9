"""Figures and plot data of a run from its logs and metadata; defines every figure."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from swarmlab.measure import clocks, formation_error, mission_timeline, tracks, traffic_totals
from swarmlab.measure.mission_timeline import BarrierPassage, MemberTimeline
from swarmlab.measure.recording import TRUTH, Recording
from swarmlab.measure.tracks import Contact, Floats, TimeSeries, VehicleTrack
from swarmlab.report.plot_data import NodeFigures, ObservedLink, PlotData
from swarmlab.report.report import P95, ExperimentReport, MeanMax, Percentiles, Receipt, TrafficFigures
from swarmlab.report.run_metadata import RunMetadata
from swarmware.geometry.world import World
from swarmware.model import paths
from swarmware.model.config import load, share_dir
from swarmware.model.names import natural
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.log import LogGap
from swarmware.types.mission import MissionProgress, MissionState
from swarmware.types.navigation import Collision, Goal
from swarmware.types.net import UNACCEPTED, LinkTransport
from swarmware.types.time import TimeFunctions
from swarmware.types.traffic import Traffic

GOAL: Final = "nav/goal"
COLLISION: Final = "sim/collision"
PROGRESS: Final = "mission/progress"
TRAFFIC: Final = "net/traffic"
FUNCTIONS: Final = "time/functions"
GAPS: Final = "log/gaps"
ENDS: Final = frozenset({"state:done", "state:failed", "state:aborted"})
"""Final events of a mission's progress."""
STATE: Final = "mission/state"
WANTED: Final = (TRUTH, GOAL, COLLISION, PROGRESS, STATE, TRAFFIC, FUNCTIONS, GAPS)


def analyse(metadata: RunMetadata, logs: Path) -> tuple[ExperimentReport, PlotData]:
    """The figures of a run, and the data of its plots.

    Raises: NotFound when a node's logs are missing.
    """
    truths = {node.platform: node.clock for node in metadata.nodes}
    recording = Recording({p: logs / p for p in truths}, truths, metadata.command_mono_ns, WANTED)
    return Analysis(metadata, recording, load(paths.world(share_dir(), metadata.world), World)).result()


class Analysis:
    """Analysis of one run; all times are true seconds since the command."""

    def __init__(self, metadata: RunMetadata, recording: Recording, world: World) -> None:
        self._metadata = metadata
        self._recording = recording
        self._world = world
        self._nodes = sorted(metadata.nodes, key=lambda node: natural(node.platform))
        self._vehicles = [node.platform for node in self._nodes if node.kind != PlatformKind.GCS]
        self._end_s = self._mission_end_s()
        self._axis = tracks.axis(0.0, self._end_s)
        self._tracks = {p: self._trimmed(recording.track(p)) for p in self._vehicles}
        self._goals = {p: recording.values(p, GOAL, Goal) for p in self._vehicles}
        self._formed = formation_error.formed_spans(self._goals, self._end_s)
        self._counters = {n.platform: recording.values(n.platform, TRAFFIC, Traffic) for n in self._nodes}
        self._errors = self._formation_errors()
        self._clock_errors = {node.platform: self._clock_errors_of(node.platform) for node in metadata.nodes}

    def _mission_end_s(self) -> float:
        """When the last platform's mission ended, from its own log, else as observed by the lab."""
        seen_s = (self._metadata.end_mono_ns - self._metadata.command_mono_ns) / 1e9
        ends: dict[str, float] = {}
        for order in self._metadata.orders:
            for t_s, step in self._recording.values(order.platform, PROGRESS, MissionProgress):
                if step.epoch == order.epoch and not step.block and step.event in ENDS:
                    ends[order.platform] = t_s
        # a node that was killed has no end in its log, so the lab's own observation counts
        everywhere = all(order.platform in ends for order in self._metadata.orders)
        # never later than observed, as clocks of logs are converted with an error
        return min(max(ends.values(), default=seen_s), seen_s) if everywhere else seen_s

    def _trimmed(self, track: VehicleTrack) -> VehicleTrack:
        keep = (track.t_s >= 0) & (track.t_s <= self._end_s)
        return VehicleTrack(track.platform, track.t_s[keep], track.xyz_m[keep], track.yaw_rad[keep])

    def _formation_errors(self) -> dict[str, Floats]:
        leader = formation_error.leader_of(self._goals)
        # without the path of the leader no slot can be computed
        if leader not in self._tracks:
            return {}
        return {
            p: formation_error.errors(self._tracks[p], self._tracks[leader], self._goals[p], self._axis)
            for p in self._vehicles
            if p != leader
        }

    def _clock_errors_of(self, platform: str) -> list[float]:
        published = self._recording.values(platform, FUNCTIONS, TimeFunctions)
        inside = [functions for t_s, functions in published if 0 <= t_s <= self._end_s]
        return [abs(error) for error in clocks.errors_us(platform, inside, self._recording.clocks)]

    def result(self) -> tuple[ExperimentReport, PlotData]:
        """The figures of the report and the data for the plots."""
        totals = {p: traffic_totals.between(known, 0.0, self._end_s) for p, known in self._counters.items()}
        return self._report(totals), self._plot_data(totals)

    def _report(self, totals: Mapping[str, traffic_totals.TrafficTotals]) -> ExperimentReport:
        metadata, duration_s = self._metadata, self._end_s
        sent = [total.sent_bytes for total in totals.values()]
        received = [total.received_bytes for total in totals.values()]
        notifications = round(sum(total.notifications for total in totals.values()))
        positions = {p: tracks.resample(track, self._axis) for p, track in self._tracks.items()}
        nearest = tracks.closest(positions, self._axis)
        receipts = self._receipts()
        formed = self._formed_errors()
        per_node = [float(np.mean(errors)) for errors in formed.values() if len(errors)]
        worst = [float(np.max(errors)) for errors in formed.values() if len(errors)]
        clock = tracks.spread([error for errors in self._clock_errors.values() for error in errors])
        reported = sum(
            gap.count for n in metadata.nodes for _, gap in self._recording.values(n.platform, GAPS, LogGap)
        )
        return ExperimentReport(
            nodes=len(metadata.nodes),
            ready_s=metadata.ready_s,
            completed=metadata.completed,
            duration_s=duration_s,
            traffic=TrafficFigures(
                global_kbps=_rate(sum(sent), duration_s),
                egress_kbps=_rate(sum(sent) / len(sent), duration_s),
                ingress_kbps=_rate(sum(received) / len(received), duration_s),
            ),
            requests=round(sum(total.requests for total in totals.values())),
            notifications=notifications,
            bytes_per_notification=sum(received) / notifications if notifications else None,
            command_to_receipt_ms=_percentiles([receipt.command_ms for receipt in receipts]),
            order_to_receipt_ms=_percentiles([receipt.order_ms for receipt in receipts]),
            last_answer_ms=self._last_answer_ms(),
            receipts=receipts,
            formation_error_m=MeanMax(
                float(np.mean(per_node)) if per_node else None, max(worst) if worst else None
            ),
            min_separation_m=nearest.distance_m if nearest else None,
            collisions=tracks.collisions(self._contacts(positions)),
            frames_lost=round(sum(total.lost_datagrams for total in totals.values())),
            log_frames=self._recording.entries,
            # gaps at the end of a log show in the reports only, gaps between two records in their numbers
            log_gaps=max(reported, self._recording.missing),
            clock_error_us=P95(clock.p95),
            cpu_percent_of_core=_mean_max([node.cpu_percent for node in metadata.nodes]),
            rss_mb=_mean_max([node.rss_mb for node in metadata.nodes]),
            pss_mb=_mean_max([node.pss_mb for node in metadata.nodes]),
            host=metadata.host,
        )

    def _receipts(self) -> tuple[Receipt, ...]:
        """Delays from the instruction and from the sending of each order to its receipt, in true time.

        The ground station's own order crossed no link and does not count.
        """
        gcs = next(node for node in self._metadata.nodes if node.kind == PlatformKind.GCS)
        station = gcs.clock.clock
        instructed_mono_ns = station.to_mono_ns(self._metadata.instructed_ns)
        found = []
        for order in sorted(self._metadata.orders, key=lambda order: natural(order.platform)):
            known = order.platform in self._recording.clocks and order.platform != gcs.platform
            # an order that never arrived has no delay, and shows in the outcome
            if order.received_ns and known:
                there = self._recording.clocks[order.platform].clock
                received_mono_ns = there.to_mono_ns(order.received_ns)
                command_ms = (received_mono_ns - instructed_mono_ns) / 1e6
                order_ms = (received_mono_ns - station.to_mono_ns(order.sent_ns)) / 1e6
                found.append(Receipt(order.platform, command_ms, order_ms))
        return tuple(found)

    def _last_answer_ms(self) -> float | None:
        """Delay from the instruction to the last answer, both on the clock of the ground station."""
        gcs = next(node for node in self._metadata.nodes if node.kind == PlatformKind.GCS)
        orders = [order for order in self._metadata.orders if order.platform != gcs.platform]
        # a maximum of the others would hide the missing answer
        if not orders or not all(order.acked_ns for order in orders):
            return None
        station = gcs.clock.clock
        last_mono_ns = station.to_mono_ns(max(order.acked_ns for order in orders))
        return (last_mono_ns - station.to_mono_ns(self._metadata.instructed_ns)) / 1e6

    def _formed_errors(self) -> dict[str, Floats]:
        formed = tracks.within(self._axis, self._formed)
        return {p: errors[formed & np.isfinite(errors)] for p, errors in self._errors.items()}

    def _contacts(self, positions: Mapping[str, Floats]) -> list[Contact]:
        """Contacts that the simulations reported, and contacts of the true paths."""
        radii = {node.platform: node.radius_m for node in self._metadata.nodes}
        # also by the true paths: a simulation that was killed reports no contact
        seen = tracks.touches(positions, radii, self._axis)
        for platform in self._vehicles:
            for t_s, hit in self._recording.values(platform, COLLISION, Collision):
                if 0 <= t_s <= self._end_s:
                    seen.append(Contact(t_s, platform, hit.other))
        return seen

    def _plot_data(self, totals: Mapping[str, traffic_totals.TrafficTotals]) -> PlotData:
        metadata = self._metadata
        receipts = {receipt.platform: receipt.command_ms for receipt in self._receipts()}
        formed = self._formed_errors()
        ground = sum(node.kind == PlatformKind.UGV for node in metadata.nodes)
        air = sum(node.kind == PlatformKind.UAV for node in metadata.nodes)
        surface = sum(node.kind == PlatformKind.USV for node in metadata.nodes)
        afloat = f"{surface} surface vessels, " if surface else ""
        return PlotData(
            title=f"{metadata.experiment.capitalize()} of {len(metadata.nodes)} nodes",
            subtitle=(
                f"{ground} ground vehicles, {afloat}{air} air vehicles, 1 ground station · {metadata.net}"
                f" · seed {metadata.seed} · {metadata.host.cores} cores · swarmware {metadata.version}"
            ),
            duration_s=self._end_s,
            nodes=tuple(
                NodeFigures(
                    platform=node.platform,
                    kind=node.kind,
                    egress_kbps=_rate(totals[node.platform].sent_bytes, self._end_s),
                    ingress_kbps=_rate(totals[node.platform].received_bytes, self._end_s),
                    receipt_ms=receipts.get(node.platform),
                    cpu_percent=node.cpu_percent,
                    rss_mb=node.rss_mb,
                    clock_error_us=tracks.spread(self._clock_errors[node.platform]).p95,
                    formation_error_m=tracks.spread(formed.get(node.platform, np.empty(0))).mean,
                    offset_s=node.clock.offset_s,
                    drift_ppm=node.clock.drift_ppm,
                    outcome=f"node ended: {node.ended}" if node.ended else node.outcome,
                    restarts=node.restarts.count,
                    log=node.log,
                )
                for node in self._nodes
            ),
            tracks=self._tracks,
            kinds={node.platform: node.kind for node in self._nodes},
            leader=formation_error.leader_of(self._goals),
            course=formation_error.course_of(self._goals),
            obstacles=tuple(self._world.obstacles()),
            formation_errors={p: TimeSeries(self._axis, errors) for p, errors in self._errors.items()},
            formed=self._formed,
            traffic={p: self._clipped(traffic_totals.egress(known)) for p, known in self._counters.items()},
            neighbours=self._neighbours(),
            unaccepted=sum(
                link.received_frames
                for known in self._counters.values()
                for link in (known[-1][1].links if known else ())
                if link.platform == UNACCEPTED
            ),
            timelines=self._timelines(),
            barriers=self._barriers(),
        )

    def _timelines(self) -> dict[str, MemberTimeline]:
        steps = {
            n.platform: self._recording.values(n.platform, PROGRESS, MissionProgress) for n in self._nodes
        }
        found = {p: mission_timeline.of_member(p, known, self._end_s) for p, known in steps.items()}
        return {p: member for p, member in found.items() if member.spans}

    def _barriers(self) -> tuple[BarrierPassage, ...]:
        epochs = {order.epoch for order in self._metadata.orders}
        states = {
            n.platform: [
                (t_s, state)
                for t_s, state in self._recording.values(n.platform, STATE, MissionState)
                if state.epoch in epochs
            ]
            for n in self._nodes
        }
        return mission_timeline.passages(states, self._recording.clocks, self._recording.origin_ns)

    def _clipped(self, series: TimeSeries) -> TimeSeries:
        keep = (series.t_s >= 0) & (series.t_s <= self._end_s)
        return TimeSeries(series.t_s[keep], series.value[keep])

    def _neighbours(self) -> tuple[ObservedLink, ...]:
        """Links between nodes: newest counters of each, and the round trips of the clock synchronisation."""
        found = []
        for platform, known in self._counters.items():
            if not known:
                continue
            functions = self._recording.values(platform, FUNCTIONS, TimeFunctions)
            newest = functions[-1][1].functions if functions else ()
            others = self._counters.keys() - {platform}
            rtts = {function.platform: function.rtt_ns / 1e6 for function in newest if function.rtt_ns}
            for link in known[-1][1].links:
                received = link.received_frames
                # only datagrams are lost on the way: TCP repeats its segments by itself
                if link.transport == LinkTransport.UDP and link.platform in others and received:
                    quality = received / (received + link.lost)
                    found.append(ObservedLink(platform, link.platform, quality, rtts.get(link.platform)))
        return tuple(found)


def _rate(amount_bytes: float, duration_s: float) -> float:
    """kB/s, 1 kB is 1 000 bytes."""
    return amount_bytes / duration_s / 1000 if duration_s > 0 else 0.0


def _percentiles(values: list[float]) -> Percentiles:
    found = tracks.spread(values)
    return Percentiles(found.p50, found.p99, found.max)


def _mean_max(values: list[float | None]) -> MeanMax:
    known = [value for value in values if value is not None]
    return MeanMax(float(np.mean(known)), max(known)) if known else MeanMax()
