"""Which platforms can be reached now, from what the broker says about neighbours and routes."""

import msgspec

from swarmware.names import hardware_id
from swarmware.types.net import Neighbours, Routes


class Reach(msgspec.Struct, frozen=True, gc=False):
    """One platform that can be reached."""

    version: int | None
    """Of its tree, as last heard; None: nothing was heard."""
    near: bool
    """Without a hop."""


def reachable(own: str, neighbours: Neighbours | None, routes: Routes | None) -> dict[str, Reach]:
    """Every other platform with a route whose main computer has said its name."""
    found: dict[str, Reach] = {}
    for route in routes.routes if routes is not None else ():
        # as long as nobody said the name there is a number in its place
        if route.hardware == hardware_id(route.platform):
            found[route.platform] = Reach(route.tree_version or None, route.via == route.platform)
    for one in neighbours.neighbours if neighbours is not None else ():
        if one.platform and one.state == "up" and one.hardware == hardware_id(one.platform):
            found[one.platform] = Reach(one.tree_version or None, True)
    found.pop(own, None)
    return found
