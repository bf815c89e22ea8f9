"""Actions of the boards of other nodes, which the shell carries out."""

import msgspec

from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmd.broker.core.membership.signatures.signature_checks import UnsignedValue
from swarmware.types.net import BoardSubscription, StructureBroadcast


class WriteMirrors(msgspec.Struct, frozen=True, gc=False):
    """Action: write values of other platforms into their mirrors."""

    values: list[tuple[BoardSubscription, RemoteValue]]


class WriteStructure(msgspec.Struct, frozen=True, gc=False):
    """Action: give the structure of a neighbour's tree to the tree of this node."""

    structure: StructureBroadcast


class KeepMirrors(msgspec.Struct, frozen=True):
    """Action: remove the mirrors of all boards that are not subscribed any more."""

    wants: tuple[BoardSubscription, ...]


class LimitEnded(msgspec.Struct, frozen=True):
    """Action: publish the rules of channels, because the time of one is over."""


class ReportUnsignedValues(msgspec.Struct, frozen=True, gc=False):
    """Action: report relayed values without a valid proof."""

    found: list[UnsignedValue]
