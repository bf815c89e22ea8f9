"""The graph of a swarm: edges from the neighbour tables of all nodes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import msgspec

from swarmctl.viewers.picture import DrawnLink, draw_topology
from swarmware.errors import missing_extra
from swarmware.model import names
from swarmware.model.platform_kind import NO_KIND, PlatformKind
from swarmware.runtime.filewriter import naming
from swarmware.types.net import LinkStatus, Neighbours


class TopologyEdge(msgspec.Struct, frozen=True):
    """A link between two nodes: platforms, or computers of them."""

    a: str
    b: str
    loss_ab_ratio: float
    """Loss of datagrams from a to b."""
    loss_ba_ratio: float
    rtt_ms: float | None
    both: bool
    """Whether the link is bidirectional."""


def edges(answers: Mapping[str, Neighbours]) -> list[TopologyEdge]:
    """Each pair of linked nodes once, in order of names; `answers` by the names of nodes."""
    received = {
        (node, one.name): one
        for node, answer in answers.items()
        for one in answer.neighbours
        if one.platform and one.state in {LinkStatus.UP, LinkStatus.RECEIVED, LinkStatus.HALF_OPEN}
    }
    out = []
    pairs = {tuple(sorted(pair, key=names.natural)) for pair in received}
    for a, b in sorted(pairs, key=lambda pair: (names.natural(pair[0]), names.natural(pair[1]))):
        # a node that did not answer leaves one side, whose own figures then count for both directions
        at_a, at_b = received.get((a, b)), received.get((b, a))
        one = at_a or at_b
        assert one is not None
        out.append(
            TopologyEdge(
                a,
                b,
                at_b.loss_in_ratio if at_b else (at_a.loss_out_ratio if at_a else 1.0),
                at_a.loss_in_ratio if at_a else (at_b.loss_out_ratio if at_b else 1.0),
                one.rtt_ms,
                all(side is None or side.state is LinkStatus.UP for side in (at_a, at_b)),
            )
        )
    return out


def between_platforms(found: list[TopologyEdge]) -> list[TopologyEdge]:
    """One link for each pair of platforms, the best one of their computers; none inside a platform."""
    best: dict[tuple[str, str], TopologyEdge] = {}
    for edge in found:
        a, b = names.platform_of(edge.a), names.platform_of(edge.b)
        known = best.get((a, b))
        # a platform is reached by the best link of any of its computers
        if a != b and (known is None or _rank(edge) < _rank(known)):
            best[a, b] = msgspec.structs.replace(edge, a=a, b=b)
    return list(best.values())


def _rank(edge: TopologyEdge) -> tuple[bool, float]:
    return not edge.both, max(edge.loss_ab_ratio, edge.loss_ba_ratio)


def to_dot(nodes: list[str], found: list[TopologyEdge]) -> str:
    """A Graphviz graph; a link that works one way only is dashed."""
    lines = ["graph swarm {", "  overlap=false; node [shape=ellipse];"]
    lines += [f'  "{node}";' for node in nodes]
    for edge in found:
        loss = max(edge.loss_ab_ratio, edge.loss_ba_ratio)
        style = "" if edge.both else ', style="dashed"'
        lines.append(f'  "{edge.a}" -- "{edge.b}" [label="{loss * 100:.0f} %"{style}];')
    return "\n".join([*lines, "}"])


def kinds(asked: list[str], answers: Mapping[str, Neighbours]) -> dict[str, PlatformKind]:
    """Kind of each node, as its neighbours know it."""
    known = {one.name: one.kind for answer in answers.values() for one in answer.neighbours}
    return {node: known.get(node, NO_KIND) for node in asked}


def to_png(nodes: Mapping[str, PlatformKind], found: list[TopologyEdge], target: str) -> None:
    """Draw the graph into a file.

    Raises: ConfigError without matplotlib.
    """
    with (
        naming(target),
        Path(target).open("wb") as file,
    ):  # first: an invalid name is reported before the slow import
        _draw(nodes, found, file)


def _draw(nodes: Mapping[str, PlatformKind], found: list[TopologyEdge], file: BinaryIO) -> None:
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise missing_extra("topo --png", error, "lab") from error

    figure = Figure(figsize=(8, 8))
    canvas: Any = FigureCanvasAgg(figure)
    lines = [
        DrawnLink(edge.a, edge.b, 1 - max(edge.loss_ab_ratio, edge.loss_ba_ratio), edge.both)
        for edge in found
    ]
    draw_topology(figure.subplots(), nodes, lines, f"{len(nodes)} nodes, {len(found)} links")
    canvas.print_png(file)
