"""The tree as lines, the swarm as a graph."""

from pathlib import Path

import msgspec

from swarmctl.commands.topo.graph import edges, to_dot, to_png
from swarmctl.commands.tree.drawing import tree
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.net import ConnectionStatus, LinkStatus, Neighbours, NeighbourState
from swarmware.types.tree import Quality, TreeEntry


def heard(platform: str, *, loss_in: float = 0.0, loss_out: float = 0.0, state: str = "up") -> NeighbourState:
    return NeighbourState(
        platform, "main", 1, PlatformKind.UAV, LinkStatus(state), "127.0.0.1:1", 0, 0.0, 10.0,
        loss_in, loss_out, 0.2,
        256, 0, 0, 1, ConnectionStatus.CONNECTED, True,
    )  # fmt: skip


def said(**neighbours: list[NeighbourState]) -> dict[str, Neighbours]:
    return {platform: Neighbours(tuple(found)) for platform, found in neighbours.items()}


def test_a_tree_is_drawn_in_the_order_of_people() -> None:
    entries = [
        TreeEntry("/uav10/nav/pose", "board", "Pose", rate_hz=20.0, quality=Quality.LIVE),
        TreeEntry("/uav2/nav", "branch", "", description="Where it is"),
        TreeEntry("/uav2/nav/pose", "board", "Pose"),
        TreeEntry("/uav2/power/voltage", "board", "Float", unit="V"),
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


def test_each_pair_is_one_edge_with_the_loss_of_either_way() -> None:
    found = edges(said(gcs=[heard("uav1", loss_in=0.25)], uav1=[heard("gcs", loss_in=0.5)]))
    assert [(e.a, e.b, e.loss_ab_ratio, e.loss_ba_ratio, e.both) for e in found] == [
        ("gcs", "uav1", 0.5, 0.25, True)
    ]


def test_what_only_one_side_says_still_counts() -> None:
    (edge,) = edges(said(gcs=[heard("uav1", loss_in=0.1, loss_out=0.2)]))
    assert (edge.loss_ab_ratio, edge.loss_ba_ratio) == (0.2, 0.1)


def test_a_half_open_link_is_dashed_and_one_that_is_down_is_none() -> None:
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


def test_edges_stand_in_the_order_of_numbers() -> None:
    found = edges(said(uav10=[heard("uav2"), heard("uav9")]))
    assert [(e.a, e.b) for e in found] == [("uav2", "uav10"), ("uav9", "uav10")]


def test_a_picture_is_written_also_of_a_node_alone(tmp_path: Path) -> None:
    target = tmp_path / "graph.png"
    to_png(["gcs"], [], str(target))
    assert target.read_bytes().startswith(b"\x89PNG")
    assert msgspec.json.encode(edges({})) == b"[]"
