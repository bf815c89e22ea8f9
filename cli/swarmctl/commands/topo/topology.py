"""The links of the swarm, queried from every platform."""

import asyncio
from typing import Final

import msgspec

from swarmctl.commands.topo.graph import TopologyEdge, between_platforms, edges, kinds, to_dot, to_png
from swarmctl.commands.topo.map_drawing import MapLink, draw_map
from swarmctl.resources.fanout import ask_all, warn_errors
from swarmctl.resources.live_view import LiveView
from swarmctl.resources.newest import newest
from swarmctl.session.session import Session
from swarmctl.terminal.table import Detail, rows_of
from swarmware.errors import Partial, SwarmError
from swarmware.model import names
from swarmware.model.names import Address
from swarmware.types import registry
from swarmware.types.net import Neighbours
from swarmware.types.rpc import Empty
from swarmware.types.vehicle import Pose

MAP_COLUMNS: Final = 80
MAP_LINES: Final = 24
"""Size of the map where stdout is not a terminal."""


class NodePosition(msgspec.Struct, frozen=True):
    """Position of a platform in the swarm's map frame."""

    x_m: float
    """East."""
    y_m: float
    """North."""
    z_m: float
    age_s: float | None


class SwarmTopology(msgspec.Struct, frozen=True):
    """Nodes, the computers of platforms, and the links between them."""

    nodes: list[str]
    links: list[TopologyEdge]
    silent: list[str]
    """Platforms that did not answer."""
    positions: dict[str, NodePosition] = {}
    """With `--watch`: of the platforms whose position is known."""


async def show_topology(session: Session, *, dot: bool, png: str) -> None:
    """Prints the links, as a Graphviz graph with `dot`; draws them into the file `png`, when one is given.

    Raises: Partial when a platform did not answer.
    """
    asked = await _computers(session, await session.selected())
    answers, errors = await ask_all(session, asked, "sys/broker/links", Empty(), Neighbours)
    found = edges(answers)
    if png:
        to_png(kinds(asked, answers), found, png)
        session.out.say(f"graph of {len(asked)} nodes and {len(found)} links to {png}")
    elif dot:
        session.out.verbatim(to_dot(asked, found))
    elif session.settings.structured:
        session.out.document(SwarmTopology(asked, found, sorted(errors)))
    else:
        details: list[Detail[TopologyEdge]] = [
            Detail("NODE", value=lambda edge: edge.a),
            Detail("NODE", value=lambda edge: edge.b),
            Detail("LOSS →", value=lambda edge: f"{edge.loss_ab_ratio * 100:.0f} %", right=True),
            Detail("LOSS ←", value=lambda edge: f"{edge.loss_ba_ratio * 100:.0f} %", right=True),
            Detail("RTT ms", value=lambda edge: edge.rtt_ms, right=True),
            Detail("BOTH WAYS", value=lambda edge: edge.both),
        ]
        empty = f"no links among {len(asked)} nodes: {', '.join(asked)}"
        session.out.table(details, rows_of(details, found), empty=empty)
    warn_errors(session, errors)
    if errors:
        raise Partial(f"topology: {len(errors)} of {len(asked)} platforms did not answer")


async def watch_topology(session: Session, count: int | None) -> None:
    """Draws a map each second: nodes at their positions, and links; for programs a document each."""

    async def draw() -> str:
        session.renew()
        asked = await session.selected()
        computers = await _computers(session, asked)
        answers, errors = await ask_all(session, computers, "sys/broker/links", Empty(), Neighbours)
        links = between_platforms(edges(answers))
        found = SwarmTopology(asked, links, sorted(errors), await _positions(session, asked))
        if session.settings.structured:
            session.out.line(found)
            return ""
        return map_text(found, session.out.width or MAP_COLUMNS, session.out.height or MAP_LINES)

    # before the first drawing: a name that matches no node is an error, not an empty map
    await session.selected()
    await LiveView(session, draw).run(count)


async def _computers(session: Session, platforms: list[str]) -> list[str]:
    """The nodes of platforms: each itself, for its computer `main`, and its other computers."""
    found = {name: {name} for name in platforms}
    own = session.module.node.address
    for address in (own, *(Address(one.platform, one.unit) for one in (await session.routes()).routes)):
        if address.platform in found:
            found[address.platform].add(str(address))
    return [node for name in platforms for node in sorted(found[name], key=names.natural)]


async def _positions(session: Session, platforms: list[str]) -> dict[str, NodePosition]:
    async def one(platform: str) -> NodePosition | None:
        try:
            found = await newest(session, names.join(platform, "nav/pose"))
            pose = registry.decode(Pose, found.data)
        except SwarmError:
            return None
        return NodePosition(pose.x_m, pose.y_m, pose.z_m, found.age_s)

    found = await asyncio.gather(*map(one, platforms))
    return {name: place for name, place in zip(platforms, found, strict=True) if place is not None}


def map_text(found: SwarmTopology, columns: int, lines: int) -> str:
    """The map with a line about the swarm, and one about nodes that are not on it."""
    elsewhere = [name for name in found.nodes if name not in found.positions]
    below = [
        f"{len(found.nodes)} nodes, {len(found.links)} links",
        f"no position: {', '.join(elsewhere)}" if elsewhere else "",
        f"no answer: {', '.join(found.silent)}" if found.silent else "",
    ]
    places = {name: (one.x_m, one.y_m) for name, one in found.positions.items()}
    links = [MapLink(link.a, link.b, link.both) for link in found.links]
    return "\n".join([*draw_map(places, links, columns, lines - 2), "; ".join(filter(None, below))])
