"""What the beacon protocol has found in a received beacon."""

import msgspec

from swarmd.broker.core.admission.signature_checks import UnsignedValue
from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmd.broker.core.topology.clock_sample import ClockSample
from swarmd.broker.core.topology.link import LinkChanged
from swarmd.broker.core.topology.neighbour import Neighbour
from swarmd.broker.core.topology.routing_table import RouteChanged
from swarmware.types.net import BoardSubscription, StructureBroadcast


class ReceivedBeacon(msgspec.Struct, frozen=True, gc=False):
    """Result of a received beacon."""

    neighbour: Neighbour
    clock_sample: ClockSample | None
    links: list[LinkChanged]
    routes: list[RouteChanged]
    values: list[tuple[BoardSubscription, RemoteValue]]
    """Values of subscribed boards."""
    structure: StructureBroadcast | None
    """Structure of its tree."""
    first_hello: bool
    """First hello of a new or restarted neighbour: answer soon with an own hello."""
    is_asked: bool
    """It asks for a beacon of this node."""
    unsigned: list[UnsignedValue]
    """Relayed values without a valid proof."""
