"""The links of the swarm, queried from every platform."""

import msgspec

from swarmctl.commands.topo.graph import TopologyEdge, edges, kinds, to_dot, to_png
from swarmctl.resources.fanout import ask_all, warn_errors
from swarmctl.session.session import Session
from swarmctl.terminal.table import Column
from swarmware.errors import Partial
from swarmware.types.net import Neighbours
from swarmware.types.rpc import Empty


class SwarmTopology(msgspec.Struct, frozen=True):
    """Platforms and the links between them."""

    nodes: list[str]
    links: list[TopologyEdge]
    silent: list[str]
    """Platforms that did not answer."""


async def show_topology(session: Session, *, dot: bool, png: str) -> None:
    """Prints the links, as a Graphviz graph with `dot`; draws them into the file `png`, when one is given.

    Raises: Partial when a platform did not answer.
    """
    asked = await session.selected()
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
        rows = [
            (
                e.a,
                e.b,
                f"{e.loss_ab_ratio * 100:.0f} %",
                f"{e.loss_ba_ratio * 100:.0f} %",
                e.rtt_ms,
                e.both,
            )
            for e in found
        ]
        columns = [
            Column("NODE"),
            Column("NODE"),
            Column("LOSS →", right=True),
            Column("LOSS ←", right=True),
            Column("RTT ms", right=True),
            Column("BOTH WAYS"),
        ]
        session.out.table(columns, rows)
    warn_errors(session, errors)
    if errors:
        raise Partial(f"topology: {len(errors)} of {len(asked)} platforms did not answer")
