"""Reachable nodes, from the broker's neighbours and routes."""

import msgspec

from swarmware.model.names import hardware_id
from swarmware.types.net import LinkStatus, Neighbours, Routes


class Reachability(msgspec.Struct, frozen=True, gc=False):
    """How one node is reachable."""

    version: int | None
    """Version of its tree in the newest beacon or route; None: unknown."""
    near: bool
    """It is a neighbour: reachable without a hop."""
    multicast: bool = False
    """It is a neighbour whose beacons come by multicast."""


def reachable(own: str, neighbours: Neighbours | None, routes: Routes | None) -> dict[str, Reachability]:
    """Every other node with a route whose name is known, by its name."""
    found: dict[str, Reachability] = {}
    for route in routes.routes if routes is not None else ():
        # a node of unknown name has a number in its place
        if route.hardware == hardware_id(route.name):
            found[route.name] = Reachability(route.tree_version or None, route.via == route.name)
    for one in neighbours.neighbours if neighbours is not None else ():
        if one.platform and one.state is LinkStatus.UP and one.hardware == hardware_id(one.name):
            found[one.name] = Reachability(one.tree_version or None, True, one.multicast)
    found.pop(own, None)
    return found
