"""The map of the swarm and the live tree: what a terminal of 80 columns shows."""

import itertools
from collections.abc import AsyncIterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmctl.commands.topo.graph import TopologyEdge
from swarmctl.commands.topo.map_drawing import MARK, MapLink, draw_map
from swarmctl.commands.topo.topology import NodePosition, SwarmTopology, map_text
from swarmctl.commands.tree.drawing import tree
from swarmctl.resources.live_view import LiveView
from swarmware.model.resource import Kind
from swarmware.types.tree import Quality, TreeEntry

NAMES = [f"uav{number}" for number in range(1, 17)]
METRES = st.floats(-1e5, 1e5)


def where(lines: list[str], name: str) -> tuple[int, int]:
    """Row and column of a name."""
    [found] = [(row, line.index(name)) for row, line in enumerate(lines) if name in line]
    return found


def test_map_has_north_up_and_equal_scales() -> None:
    lines = draw_map({"a0": (0, 0), "e0": (100, 0), "n0": (0, 100)}, [], 80, 24)
    west, east, north = (where(lines, name) for name in ("a0", "e0", "n0"))
    assert west[0] == east[0] > north[0]
    assert west[1] == north[1] < east[1]
    # a character is twice as high as wide
    assert abs((east[1] - west[1]) - 2 * (west[0] - north[0])) <= 2
    assert lines[-1].endswith("m   north is up")


def test_links_are_lines_between_nodes() -> None:
    places = {"a0": (0.0, 0.0), "b0": (100.0, 0.0)}
    assert not any("·" in line for line in draw_map(places, [], 80, 24))
    assert any("····" in line for line in draw_map(places, [MapLink("a0", "b0", True)], 80, 24))
    assert any("╌╌╌╌" in line for line in draw_map(places, [MapLink("a0", "b0", False)], 80, 24))
    draw_map(places, [MapLink("a0", "elsewhere", True)], 80, 24)


@given(
    st.dictionaries(st.sampled_from(NAMES), st.tuples(METRES, METRES), max_size=16),
    st.integers(20, 200),
    st.integers(4, 60),
)
def test_map_fits_its_terminal_and_has_every_node(
    places: dict[str, tuple[float, float]], width: int, height: int
) -> None:
    links = [MapLink(a, b, True) for a, b in itertools.pairwise(places)]
    lines = draw_map(places, links, width, height)
    assert len(lines) <= height
    assert max(map(len, lines)) <= width
    marks = sum(line.count(MARK) for line in lines)
    assert (1 <= marks <= len(places)) if places else marks == 0


def test_sixteen_nodes_have_names_at_80_columns() -> None:
    places = {name: (50.0 * (number % 4), 50.0 * (number // 4)) for number, name in enumerate(NAMES)}
    lines = draw_map(places, [], 80, 22)
    assert sum(line.count(MARK) for line in lines) == 16
    assert all(any(name in line for line in lines) for name in NAMES)


def test_node_off_map_is_named_below() -> None:
    found = SwarmTopology(
        ["gcs", "uav1", "uav2"],
        [TopologyEdge("uav1", "uav2", 0.0, 0.0, 1.0, True)],
        ["uav2"],
        {"uav1": NodePosition(0, 0, 5, 0.1), "uav2": NodePosition(9, 9, 5, 3.0)},
    )
    lines = map_text(found, 80, 24).splitlines()
    assert lines[-1] == "3 nodes, 1 links; no position: gcs; no answer: uav2"
    assert len(lines) <= 24
    assert "no position is known" in map_text(SwarmTopology(["gcs"], [], [], {}), 80, 24)


def test_a_live_tree_has_ages_and_measured_rates() -> None:
    entry = TreeEntry(
        "/uav1/nav/pose", Kind.BOARD, "Pose", age_s=0.123, quality=Quality.LIVE, measured_hz=19.96
    )
    assert tree([entry], live=True)[-1].endswith("pose  Pose 20 Hz 0.1s [live]")
    assert "Hz" not in tree([entry])[-1]


class Terminal:
    """Ticks at once, and keeps what is drawn."""

    def __init__(self, *, redraws: bool) -> None:
        self.redraws = redraws
        self.drawn: list[tuple[str, str]] = []
        self.ended = False
        self.module = self
        self.out = self

    async def every(self, period_s: float) -> AsyncIterator[int]:
        for number in itertools.count():
            yield number

    def redraw(self, text: str, *, last: bool) -> None:
        self.ended = last
        self.drawn.append(("redraw", text))

    def now(self, text: str) -> None:
        self.drawn.append(("now", text))


@pytest.mark.parametrize("redraws", [True, False])
async def test_view_is_drawn_as_often_as_requested(redraws: bool) -> None:
    terminal: Any = Terminal(redraws=redraws)
    texts = iter(("one", "", "two"))

    async def draw() -> str:
        return next(texts)

    await LiveView(terminal, draw).run(3)
    how = "redraw" if redraws else "now"
    assert terminal.drawn == [(how, "one"), (how, "two")]
    assert terminal.ended is redraws
