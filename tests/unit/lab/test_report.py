"""The report: fixed keys, the paper's figures beside ours, one page that needs nothing else."""

import json
from html.parser import HTMLParser

import msgspec
import numpy as np
import pytest

from swarmctl.terminal.output import plain_table
from swarmlab.measure.host import HostInfo
from swarmlab.measure.tracks import TimeSeries, VehicleTrack
from swarmlab.report import page, plots, report
from swarmlab.report.plot_data import NodeFigures, ObservedLink, PlotData
from swarmlab.report.report import P95, ExperimentReport, MeanMax, Percentiles, Receipt, TrafficFigures
from swarmware.geometry.world import Box, Circle
from swarmware.model.platform_kind import PlatformKind

GOOD = ExperimentReport(
    nodes=16,
    ready_s=9.3125,
    completed=True,
    duration_s=120.123456,
    traffic=TrafficFigures(16.1, 1.01, 15.2),
    requests=45,
    notifications=123456,
    bytes_per_notification=88.8,
    command_to_receipt_ms=Percentiles(1.5, 3.3, 3.4),
    order_to_receipt_ms=Percentiles(0.5, 1.3, 1.4),
    receipts=(Receipt("ugv1", 1.5, 0.5), Receipt("uav1", 3.41234567, 1.4)),
    formation_error_m=MeanMax(0.21, 0.8),
    min_separation_m=1.9,
    collisions=0,
    frames_lost=2,
    log_frames=99999,
    log_gaps=0,
    clock_error_us=P95(22.25678),
    cpu_percent_of_core=MeanMax(5.1, 8.8),
    rss_mb=MeanMax(77, 81),
    host=HostInfo("Some CPU", 2, "6.1", 0.1, 88.0, 12.0),
)

KEYS = json.loads(
    '{"schema_version":2,"nodes":16,"ready_s":0,"completed":true,"duration_s":0,"traffic":{"global_kbps":0,"egress_kbps":0,'
    '"ingress_kbps":0},"requests":0,"notifications":0,"bytes_per_notification":0,"command_to_receipt_ms":'
    '{"p50":0,"p99":0,"max":0},"order_to_receipt_ms":{"p50":0,"p99":0,"max":0},"receipts":[],"formation_error_m":{"mean":0,"max":0},"min_separation_m":0,"collisions":0,'
    '"frames_lost":0,"log_frames":0,"log_gaps":0,"clock_error_us":{"p95":0},"cpu_percent_of_core":{"mean":0,'
    '"max":0},"rss_mb":{"mean":0,"max":0},"host":{"processor":"","cores":2,"kernel":"","load_before":0,'
    '"nodes_percent":0,"others_percent":0}}'
)
"""The promised document; programs of others read these keys."""


def test_the_documents_keys_are_those_promised_and_no_others() -> None:
    def shape(value: object) -> object:
        return {k: shape(v) for k, v in value.items()} if isinstance(value, dict) else None

    assert shape(report.rounded(GOOD)) == shape(KEYS)
    assert list(report.rounded(GOOD)) == list(KEYS)


def test_numbers_have_four_significant_digits_and_counts_have_all() -> None:
    found = report.rounded(GOOD)
    assert (found["duration_s"], found["notifications"]) == (120.1, 123456)
    assert found["clock_error_us"] == {"p95": 22.26}
    assert msgspec.convert(found["receipts"], tuple[Receipt, ...])[1].command_ms == 3.412


def test_the_table_shows_the_papers_figures_beside_ours() -> None:
    text = plain_table(report.COLUMNS, [[str(cell) for cell in row] for row in report.cells(GOOD)])
    for figure in ("56.07", "14.89", "1.31", "25", "81 297", "11.95 ms", "16.10 kB/s", "123 456", "1.5 ms"):
        assert figure in text


def test_a_figure_that_could_not_be_measured_is_a_dash_not_a_zero() -> None:
    nothing = msgspec.structs.replace(
        GOOD, min_separation_m=None, command_to_receipt_ms=Percentiles(), formation_error_m=MeanMax()
    )
    rows = {row.what: row.ours for row in report.comparison(nothing)}
    assert rows["minimum separation"] == rows["command to receipt"] == rows["formation error"] == "-"


def test_a_collision_or_an_unfinished_mission_fails_the_experiment() -> None:
    assert report.shortfalls(GOOD) == []
    bad = msgspec.structs.replace(GOOD, completed=False, collisions=2)
    assert report.shortfalls(bad) == ["the mission was not completed", "2 collisions"]


def test_goals_that_were_missed_are_named_with_the_goal() -> None:
    assert report.misses(GOOD) == []
    slow = msgspec.structs.replace(
        GOOD, ready_s=15.0, command_to_receipt_ms=Percentiles(6.5, 12.5, 13), bytes_per_notification=None
    )
    assert [text.split(":")[0] for text in report.misses(slow)] == [
        "ready",
        "command to receipt, p50",
        "command to receipt, p99",
        "bytes per notification",
    ]


def scene() -> PlotData:
    t_s = np.arange(0, 60, 0.5)
    xyz = np.stack([t_s, np.sin(t_s / 9) * 5, np.full(len(t_s), 2.0)], axis=1)
    kinds = {"gcs": "gcs", "ugv1": "ugv", "uav1": "uav"}
    return PlotData(
        title="Formation <of> 3 & more",
        subtitle="seed 1",
        nodes=tuple(NodeFigures(platform=name, kind=PlatformKind(kind)) for name, kind in kinds.items()),
        tracks={
            name: VehicleTrack(name, t_s, xyz + i, np.zeros(len(t_s)))
            for i, name in enumerate(("ugv1", "uav1"))
        },
        kinds={name: PlatformKind(kind) for name, kind in kinds.items()},
        leader="ugv1",
        course=((0, 0), (60, 0)),
        obstacles=(
            Circle(name="tree", x_m=20, y_m=9, radius_m=1, height_m=4),
            Box(name="shed", x_m=40, y_m=-9, size_m=(4, 2), height_m=3, yaw_rad=0.5),
        ),
        formation_errors={"uav1": TimeSeries(t_s, np.where(t_s < 10, np.nan, 0.2))},
        formed=((15.0, 50.0),),
        traffic={name: TimeSeries(t_s, np.full(len(t_s), 1.5)) for name in kinds},
        neighbours=(
            ObservedLink("gcs", "ugv1", 0.9, 0.4),
            ObservedLink("ugv1", "gcs", 1.0),
            ObservedLink("gcs", "uav1", 1),
        ),
    )


EMPTY = PlotData(title="Nothing", subtitle="", nodes=(), tracks={}, kinds={})


@pytest.mark.parametrize("shown", [scene(), EMPTY], ids=["full", "empty"])
def test_every_picture_can_be_drawn_even_of_a_run_that_recorded_nothing(shown: PlotData) -> None:
    pictures = [
        plots.paths(shown),
        plots.formation(shown, 1.0),
        plots.receipts(shown, GOOD.receipts if shown.nodes else ()),
        plots.topology(shown),
        plots.traffic(shown),
    ]
    assert all(png.startswith(b"\x89PNG") for png in pictures)


class Outline(HTMLParser):
    """Tags left open, and everything the page would have to fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.fetched: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.fetched += [
            value[:30] for key, value in attrs if key in {"src", "href"} and value and value[:5] != "data:"
        ]
        if tag not in {"meta", "img", "br"}:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_is_well_formed_escaped_and_fetches_nothing() -> None:
    html = page.page(scene(), GOOD, {"Paths": b"\x89PNG"}, ["ready: 16 s, goal below <15> s"])
    outline = Outline()
    outline.feed(html)
    assert outline.open == []
    assert outline.fetched == []
    assert "Formation &lt;of&gt; 3 &amp; more" in html
    assert "goal below &lt;15&gt; s" in html
    assert "data:image/png;base64,iVBORw" in html
