"""The tree as lines, the swarm as a graph."""

from pathlib import Path
from typing import Any

import msgspec

from swarmctl.commands.topo import graph
from swarmctl.commands.topo.graph import between_platforms, edges, to_dot, to_png
from swarmctl.commands.tree.drawing import tree
from swarmctl.viewers.picture import DrawnLink, draw_topology
from swarmware.model.platform_kind import PlatformKind
from swarmware.model.resource import Kind
from swarmware.types.net import ConnectionStatus, LinkStatus, Neighbours, NeighbourState
from swarmware.types.tree import Quality, TreeEntry


def heard(
    platform: str, *, unit: str = "main", loss_in: float = 0.0, loss_out: float = 0.0, state: str = "up"
) -> NeighbourState:
    return NeighbourState(
        platform, unit, 1, PlatformKind.UAV, LinkStatus(state), "127.0.0.1:1", 0, 0.0, 10.0,
        loss_in, loss_out, 0.2,
        256, 0, 0, 1, ConnectionStatus.CONNECTED, True,
    )  # fmt: skip


def said(**neighbours: list[NeighbourState]) -> dict[str, Neighbours]:
    return {platform: Neighbours(tuple(found)) for platform, found in neighbours.items()}


def test_tree_is_drawn_in_order_of_people() -> None:
    entries = [
        TreeEntry("/uav10/nav/pose", Kind.BOARD, "Pose", rate_hz=20.0, quality=Quality.LIVE),
        TreeEntry("/uav2/nav", Kind.BRANCH, "", description="Where it is"),
        TreeEntry("/uav2/nav/pose", Kind.BOARD, "Pose"),
        TreeEntry("/uav2/power/voltage", Kind.BOARD, "Float", unit="V"),
    ]
    assert tree(entries) == [
        "├── uav2",
        "│   ├── nav  Where it is",
        "│   │   └── pose  board Pose",
        "│   └── power",
        "│       └── voltage  board Float V",
        "└── uav10",
        "    └── nav",
        "        └── pose  board Pose 20 Hz [live]",
    ]


def test_each_pair_is_one_edge_with_loss() -> None:
    found = edges(said(gcs=[heard("uav1", loss_in=0.25)], uav1=[heard("gcs", loss_in=0.5)]))
    assert [(e.a, e.b, e.loss_ab_ratio, e.loss_ba_ratio, e.both) for e in found] == [
        ("gcs", "uav1", 0.5, 0.25, True)
    ]


def test_what_only_one_side_says_still_counts() -> None:
    (edge,) = edges(said(gcs=[heard("uav1", loss_in=0.1, loss_out=0.2)]))
    assert (edge.loss_ab_ratio, edge.loss_ba_ratio) == (0.2, 0.1)


def test_half_open_link_is_dashed_and_down_absent() -> None:
    found = edges(
        said(
            gcs=[heard("uav1", state="half_open"), heard("uav2", state="down"), heard("", state="heard")],
            uav1=[heard("gcs")],
        )
    )
    assert [(e.a, e.b, e.both) for e in found] == [("gcs", "uav1", False)]
    dot = to_dot(["gcs", "uav1", "uav2"], found)
    assert '"gcs" -- "uav1" [label="0 %", style="dashed"];' in dot
    assert '"uav2";' in dot


def test_computers_of_platform_are_separate_nodes() -> None:
    answers = {
        "gcs": Neighbours((heard("uav1", loss_in=0.5), heard("uav1", unit="fc", loss_in=0.25))),
        "uav1": Neighbours((heard("gcs", loss_in=0.5), heard("uav1", unit="fc"))),
        "uav1.fc": Neighbours((heard("gcs", loss_in=0.25), heard("uav1"))),
    }
    found = edges(answers)
    assert [(e.a, e.b) for e in found] == [("gcs", "uav1"), ("gcs", "uav1.fc"), ("uav1", "uav1.fc")]
    (one,) = between_platforms(found)
    assert (one.a, one.b, one.loss_ab_ratio) == ("gcs", "uav1", 0.25), "the better one of both"


def test_edges_stand_in_the_order_of_numbers() -> None:
    found = edges(said(uav10=[heard("uav2"), heard("uav9")]))
    assert [(e.a, e.b) for e in found] == [("uav2", "uav10"), ("uav9", "uav10")]


def test_picture_is_written_also_of_node_alone(tmp_path: Path) -> None:
    target = tmp_path / "graph.png"
    to_png({"gcs": PlatformKind.GCS}, [], str(target))
    assert target.read_bytes().startswith(b"\x89PNG")
    assert msgspec.json.encode(edges({})) == b"[]"


class Axes:
    """What was drawn, in place of matplotlib's axes."""

    def __init__(self) -> None:
        self.lines: list[tuple[float, str]] = []
        self.nodes: dict[str, tuple[float, float]] = {}
        self.colours: list[str] = []

    def plot(self, x: Any, _y: Any, **look: Any) -> None:
        if isinstance(x, list):
            self.lines.append((look["alpha"], look["linestyle"]))
        else:
            self.colours.append(look["color"])

    def text(self, x: float, y: float, name: str, **_: Any) -> None:
        self.nodes[name] = (round(x, 3), round(y, 3))

    def __getattr__(self, _: str) -> Any:
        return lambda *_words, **_look: None


def test_topology_is_clockwise_with_weaker_bad_links() -> None:
    axes = Axes()
    kinds = {"gcs": PlatformKind.GCS, "uav1": PlatformKind.UAV, "x": PlatformKind("boat")}
    links = [
        DrawnLink("gcs", "uav1", 1.0),
        DrawnLink("gcs", "x", 0.25, both=False),
        DrawnLink("x", "gcs", -1),
    ]
    draw_topology(axes, kinds, links, "three")
    assert axes.nodes == {"gcs": (0.0, 1.16), "uav1": (1.005, -0.58), "x": (-1.005, -0.58)}, "clockwise"
    assert axes.colours == ["#009e73", "#0072b2", "#1f2933"], "by kind, also one that is not known"
    (best, solid), (poor, dashed), (worst, _) = axes.lines
    assert (solid, dashed) == ("-", "--")
    assert best > poor > worst > 0


def test_kind_of_platform_is_what_its_neighbours_know() -> None:
    answers = said(gcs=[heard("uav1")])
    assert graph.kinds(["gcs", "uav1"], answers) == {"gcs": "", "uav1": PlatformKind.UAV}
