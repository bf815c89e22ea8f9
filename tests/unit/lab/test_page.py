"""The page of a report: every node named, blocks and barriers, a replay, nothing from outside."""

import json
import re
from collections.abc import Callable
from html.parser import HTMLParser
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from tests.unit.lab.logs import facts
from tests.unit.lab.reports import GOOD

from swarmlab.measure.mission_timeline import BarrierPassage, BlockSpan, MemberTimeline
from swarmlab.measure.tracks import Floats, TimeSeries, VehicleTrack, resample
from swarmlab.report import charts, labels, link_chart, page, plots, replay, timeline_chart
from swarmlab.report.plot_data import NodeFigures, ObservedLink, PlotData
from swarmlab.report.scale import Scale
from swarmlab.report.svg import simplified
from swarmware.geometry.world import Box, Circle
from swarmware.model.names import natural
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionPhase


def scene() -> PlotData:
    t_s = np.arange(0, 60, 0.5)
    xyz = np.stack([t_s, np.sin(t_s / 9) * 5, np.full(len(t_s), 2.0)], axis=1)
    kinds = {"gcs": "gcs", "ugv1": "ugv", "uav1": "uav"}
    spans = (
        BlockSpan("takeoff", "Takeoff", 1.0, 12.0, "ok"),
        BlockSpan("airborne", "Barrier", 12.0, 15.0, "ok"),
        BlockSpan("form", "Formation", 15.0, 50.0, "error:lost", "no pose"),
    )
    return PlotData(
        title="Formation <of> 3 & more",
        subtitle="seed 1",
        duration_s=60.0,
        nodes=tuple(
            NodeFigures(platform=name, kind=PlatformKind(kind), log=f"logs/{name}/node.log")
            for name, kind in kinds.items()
        ),
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
        timelines={name: MemberTimeline(name, spans, MissionPhase.FAILED, 50.0) for name in kinds},
        barriers=(
            BarrierPassage("airborne", 1, 15.0, 0.0001, 3),
            BarrierPassage("down", 2, 52.0, 0.0, 1, broken=True),
        ),
        traffic={name: TimeSeries(t_s, np.full(len(t_s), 1.5)) for name in kinds},
        neighbours=(
            ObservedLink("gcs", "ugv1", 0.9, 0.4),
            ObservedLink("ugv1", "gcs", 1.0),
            ObservedLink("gcs", "uav1", 1),
        ),
    )


EMPTY = PlotData(title="Nothing", subtitle="", nodes=(), tracks={}, kinds={})


class Outline(HTMLParser):
    """Tags left open, links, and all other attributes that could name something outside."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.fetched: list[str] = []
        self.unnamed: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        known = {key: value or "" for key, value in attrs}
        if tag == "a":
            self.links.append(known["href"])
        elif {"src", "href", "srcset", "action", "xlink:href"} & known.keys():
            self.fetched.append(str(known))
        if tag in {"svg", "section"} and not known.keys() & {"aria-label", "aria-hidden", "id"}:
            self.unnamed.append(str(known))
        if tag not in {"meta", "img", "br", "input", "link"}:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def shown(data: PlotData, nodes: int = 16, exists: Callable[[str], bool] = lambda _: True) -> str:
    found = msgspec.structs.replace(GOOD, nodes=nodes)
    run = msgspec.structs.replace(
        facts(),
        command="swarmctl lab run formation --nodes 3 <x>",
        commit="abc1234",
        versions={"Python": "3.11"},
    )
    return page.page(data, found, run, ["ready: 16 s, goal below <15> s"], exists)


@pytest.mark.parametrize("data", [scene(), EMPTY], ids=["full", "empty"])
def test_page_is_well_formed_escaped_and_self_contained(data: PlotData) -> None:
    html = shown(data)
    outline = Outline()
    outline.feed(html)
    assert (outline.open, outline.fetched, outline.unnamed) == ([], [], [])
    assert all(re.fullmatch(r"#[a-z]+|[a-z0-9./]+", link) for link in outline.links), "within the folder"
    assert "logs/" in outline.links and "run.json" in outline.links
    assert not re.search(
        r"https?:|//[a-z]|@import|url\((?!#)|fetch\(|XMLHttp|import\(", html.replace("// ", "")
    )
    assert "default-src 'none'" in html
    assert "goal below &lt;15&gt; s" in html
    assert plots.paths(data).startswith(b"\x89PNG")


def test_page_names_nodes_blocks_barriers_and_origin() -> None:
    html = shown(scene())
    for name in ("uav1", "ugv1"):
        assert f'data-name="{name}"' in html
    for name in ("gcs", "uav1", "ugv1"):
        assert f"{name}: takeoff (Takeoff), 1.00–12.00 s, ok" in html
        assert f"{name}: form (Formation), 15.00–50.00 s, error:lost, no pose" in html
        assert f'href="logs/{name}/node.log"' in html
    assert "barrier airborne: opened after 15.000 s for 3 members, 0.1 ms apart" in html
    assert "barrier down (2): did not open" in html
    late = timeline_chart.passage_text(BarrierPassage("start", 1, 1.0, 0.18, 3))
    assert late.endswith("180.0 ms apart"), "without an exponent"
    assert "Formation &lt;of&gt; 3 &amp; more" in html
    assert "swarmctl lab run formation --nodes 3 &lt;x&gt;" in html
    assert all(word in html for word in ("abc1234", "Python 3.11", "Some CPU, 2 cores", "6.1"))
    assert "during the mission the nodes used 88 % of a core, other processes 12 %" in html
    assert "logarithmic axis" in html and "linear axis" in html


def test_only_page_of_16_nodes_shows_papers_figures() -> None:
    assert "paper" in shown(scene()).lower()
    few = shown(scene(), nodes=3)
    assert "this run has 3" in few
    assert not any(figure in few for figure in ("56.07", "14.89", "the paper's figure<", "paper, "))


def test_nodes_have_their_natural_order_in_every_chart() -> None:
    names = ["gcs", "uav1", "uav2", "uav10", "ugv1"]
    assert sorted(names, key=natural) == names
    kinds = {name: PlatformKind(name.rstrip("0123456789")) for name in names}
    data = msgspec.structs.replace(
        scene(),
        kinds=kinds,
        nodes=tuple(NodeFigures(platform=name, kind=kinds[name]) for name in names),
        timelines={name: MemberTimeline(name, ()) for name in names},
    )
    rows = re.findall(r">([a-z]+[0-9]*)</text>", timeline_chart.timeline(data))
    bars = re.findall(r">([a-z]+[0-9]*)</text>", charts.traffic_per_node(data, GOOD))
    table = re.findall(r"<th scope=row>([a-z]+[0-9]*)</th><td>", shown(data))
    assert [name for name in rows if name in names] == bars == table == names


def test_numbers_of_column_have_equally_many_decimals() -> None:
    nodes = (
        NodeFigures(platform="uav1", kind=PlatformKind.UAV, egress_kbps=1.3, cpu_percent=6.0, restarts=0),
        NodeFigures(platform="uav2", kind=PlatformKind.UAV, egress_kbps=12.345, cpu_percent=0.25, restarts=2),
    )
    table = shown(msgspec.structs.replace(scene(), nodes=nodes)).partition("Nodes</h2>")[2]
    rows = [re.findall(r"<td class=n>([0-9.]*)</td>", row) for row in table.split("<tr>")[2:4]]
    assert [(row[0], row[5], row[9]) for row in rows] == [("1.30", "6.00", "0"), ("12.35", "0.25", "2")]


def vehicles(count: int, end_s: float) -> PlotData:
    rng = np.random.default_rng(7)
    names = [f"uav{i + 1}" for i in range(count)]
    made = {}
    for name in names:
        t_s = np.arange(0, end_s, 0.05)
        xyz = np.cumsum(rng.normal(0, 0.1, (len(t_s), 3)), axis=0) - 60
        made[name] = VehicleTrack(name, t_s, xyz, np.cumsum(rng.normal(0, 0.1, len(t_s))))
    return msgspec.structs.replace(
        scene(), duration_s=end_s, tracks=made, kinds=dict.fromkeys(names, PlatformKind.UAV), timelines={}
    )


def decoded(text: str) -> dict[str, tuple[Floats, Floats]]:
    """Instants in s and positions in m of each vehicle, by the documented encoding."""
    found = {}
    document = json.loads(text)
    for vehicle in document["vehicles"]:
        t_s, xyz = [], []
        for piece in vehicle["pieces"]:
            columns = [np.cumsum(piece[key]) / 100 for key in ("x", "y", "z")]
            t_s.append((piece["at"] + np.arange(len(columns[0]))) * document["step_ms"] / 1000)
            xyz.append(np.stack(columns, axis=1))
        found[vehicle["name"]] = (np.concatenate(t_s), np.concatenate(xyz))
    return found


def test_the_replay_has_every_position_within_a_centimetre() -> None:
    data = vehicles(3, 30.0)
    track = data.tracks["uav2"]
    keep = (track.t_s < 10) | (track.t_s > 14)
    data.tracks["uav2"] = VehicleTrack("uav2", track.t_s[keep], track.xyz_m[keep], track.yaw_rad[keep])
    for name, (t_s, xyz) in decoded(replay.encoded(data)).items():
        truth = resample(data.tracks[name], t_s)
        assert np.abs(truth - xyz).max() < 0.01
        inside = data.tracks[name].t_s[data.tracks[name].t_s < t_s[-1]]
        away = np.abs(inside[:, None] - t_s[None, :]).min(axis=1)
        assert away.max() <= 0.05 + 1e-9, "an instant within 50 ms of each sample"
    t_s, _ = decoded(replay.encoded(data))["uav2"]
    assert not ((t_s > 10) & (t_s < 14)).any(), "a hole stays a hole"


def test_page_is_small_and_long_flight_thinned() -> None:
    assert len(shown(vehicles(15, 90.0)).encode()) < 2_000_000
    long = vehicles(30, 1200.0)
    assert replay.step_ms(long) == 800
    assert len(replay.encoded(long)) < 1_500_000


def test_equal_links_are_sentence_and_different_ones_matrix() -> None:
    names = [node.platform for node in scene().nodes]
    pairs = [(a, b) for a in names for b in names if a != b]
    equal = msgspec.structs.replace(
        scene(), neighbours=tuple(ObservedLink(a, b, 0.999, 0.3) for a, b in pairs)
    )
    assert link_chart.matrices(equal) == ""
    assert "6 of 6 directions" in link_chart.summary(equal).text
    assert "Loss is equal on all of them: 0.1 %" in shown(equal)
    lossy = msgspec.structs.replace(
        equal, neighbours=(*equal.neighbours[1:], ObservedLink(*pairs[0], 0.7, 80.0))
    )
    drawn = link_chart.matrices(lossy)
    a, b = pairs[0]
    assert f"{a} receives from {b}: loss 30 %" in drawn
    assert f"{a} receives from {b}: round-trip time 80 ms" in drawn
    assert drawn.count("cell level-4") == 2 + 2, "one cell and one entry of the legend in each matrix"
    assert "no traffic" in link_chart.matrices(
        msgspec.structs.replace(equal, neighbours=equal.neighbours[1:])
    ), "a missing link is shown"


def test_datagrams_of_refused_senders_belong_to_no_link() -> None:
    assert "belong to no link" not in shown(scene())
    found = shown(msgspec.structs.replace(scene(), unaccepted=29))
    assert "29 datagrams belong to no link: their sender was not accepted" in found
    assert ">?<" not in found


def test_a_short_round_trip_is_not_none() -> None:
    links = (ObservedLink("gcs", "uav1", 1.0, 0.0042), ObservedLink("uav1", "gcs", 1.0, 0.07))
    text = link_chart.summary(msgspec.structs.replace(scene(), neighbours=links)).text
    assert "0.0042 to 0.07 ms" in text


def test_the_page_links_only_files_that_exist() -> None:
    there = {"report.json", "run.json", "logs/", "logs/gcs/", "logs/gcs/node.log", "logs/uav1/"}
    outline = Outline()
    outline.feed(shown(scene(), exists=there.__contains__))
    assert {link for link in outline.links if not link.startswith("#")} == there


def test_printed_page_is_a4_without_player() -> None:
    style = shown(scene()).partition("<style>")[2].partition("</style>")[0]
    assert re.search(r"@page \{ size: A4;", style)
    rules = re.findall(r"([^{}]+)\{([^{}]*)\}", style.partition("@media print {")[2])

    def declared(selector: str) -> str:
        return "".join(body for names, body in rules if selector in re.split(r",\s*", names.strip()))

    for hidden in (".player", "nav", "#tip"):
        assert "display: none" in declared(hidden), hidden
    for whole in ("figure", "tr", "dl"):
        assert "break-inside: avoid" in declared(whole), whole
    assert "overflow: visible" in declared(".scroll") and "min-width: 0" in declared("svg.chart")
    assert "display: table-header-group" in declared("thead")


def test_ticks_are_round_and_within_their_axis() -> None:
    assert Scale(0.0, 30.0, 0, 100).ticks() == [0, 5, 10, 15, 20, 25, 30]
    assert Scale(0.01, 31.0, 0, 100, log=True).ticks()[:4] == pytest.approx([0.01, 0.02, 0.05, 0.1])
    assert Scale(1e-4, 1e4, 0, 100, log=True).ticks(4) == pytest.approx([10.0**n for n in range(-4, 5)])
    assert Scale(0.01, 1.0, 0, 100, log=True).px(0.1) == pytest.approx(50)


def test_no_two_labels_overlap() -> None:
    places = labels.spread([5.0, 5.0, 5.0, 90.0], 10.0, 0.0, 100.0)
    assert places is not None
    ordered = sorted(places)
    assert all(b - a >= 10 - 1e-9 for a, b in pairwise(ordered))
    assert ordered[0] >= 0 and ordered[-1] <= 100
    assert labels.spread([1.0] * 20, 10.0, 0.0, 100.0) is None
    area = labels.LabelBox(0, 0, 400, 300)
    placed = labels.around([(f"uav{i}", 200.0 + i, 150.0) for i in range(40)], 12.0, area)
    assert len(placed) > 8
    assert not any(a.box.overlaps(b.box) for i, a in enumerate(placed) for b in placed[:i])


def test_line_has_few_points_within_tolerance() -> None:
    x = np.linspace(0, 500, 5000)
    points = np.stack([x, 100 * np.sin(x / 50)], axis=1)
    few = simplified(points, 0.25)
    assert 20 < len(few) < 200
    assert np.abs(np.interp(x, few[:, 0], few[:, 1]) - points[:, 1]).max() < 0.5
