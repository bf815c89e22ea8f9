"""Actions of the broker's core: what the shell carries out."""

import msgspec

from swarmd.broker.core.admission.roster_exchange import ApplyRoster, SendRoster
from swarmd.broker.core.admission.signature_checks import UnsignedValue
from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmd.broker.core.topology.link import LinkChanged
from swarmware.types.net import BoardSubscription, StructureBroadcast
from swarmware.types.time import TimingBatch


class PollInputs(msgspec.Struct, frozen=True):
    """Action: receive the waiting datagrams, then call `on_inputs_read`."""

    boards: bool
    """Also read the plan and the values of the own boards: a beacon is due."""


class SendBeacon(msgspec.Struct, frozen=True):
    """Action: compose the next beacon with `BrokerCore.compose` and send it."""


class WriteMirrors(msgspec.Struct, frozen=True, gc=False):
    """Action: write values of other platforms into their mirrors."""

    values: list[tuple[BoardSubscription, RemoteValue]]


class WriteStructure(msgspec.Struct, frozen=True, gc=False):
    """Action: give the structure of a neighbour's tree to the tree of this node."""

    structure: StructureBroadcast


class KeepMirrors(msgspec.Struct, frozen=True):
    """Action: remove the mirrors of all boards that are not subscribed any more."""

    wants: tuple[BoardSubscription, ...]


class PublishTables(msgspec.Struct, frozen=True):
    """Action: write the tables of neighbours and routes."""

    traffic: bool
    """Also the traffic counters."""


class LimitEnded(msgspec.Struct, frozen=True):
    """Action: publish the rules of channels, because the time of one is over."""


class WriteClockSamples(msgspec.Struct, frozen=True):
    """Action: write the clock samples since the last own beacon."""

    batch: TimingBatch


class AdoptSession(msgspec.Struct, frozen=True):
    """Action: accept the sequence numbers of a session from now on."""

    hw: int
    session: int


class ProveSession(msgspec.Struct, frozen=True):
    """Action: send a neighbour the own session over a connection that only the own key opens."""

    hw: int
    session: int


class MediumChanged(msgspec.Struct, frozen=True):
    """Action: frames to a neighbour take another medium from now on."""

    hw: int


class ReportDuplicate(msgspec.Struct, frozen=True):
    """Action: report that two computers use one platform name."""

    platform: str
    own: bool
    """It is the own name."""
    first: bool
    """It was not reported before."""


class ReportDuplicateGone(msgspec.Struct, frozen=True):
    """Action: report that each platform name is used by one computer again."""


class ReportSlowdown(msgspec.Struct, frozen=True):
    """Action: report a change of the factor by which beacons are slowed; 1: the processor keeps up."""

    factor: float
    late_ns: int
    """Median lateness of the last beacons."""


class ReportUnsignedValues(msgspec.Struct, frozen=True, gc=False):
    """Action: report relayed values without a valid proof."""

    found: list[UnsignedValue]


class ReportImpersonation(msgspec.Struct, frozen=True):
    """Action: report a beacon that a member has sealed in the name of another one."""

    hw: int
    """Whose name it used."""
    host: str
    """Its source address."""
    is_other_key: bool = False
    """It has a signature, and its session is not accepted: perhaps that node signs with another key than the
    roster has."""


Action = (
    PollInputs
    | SendBeacon
    | WriteMirrors
    | WriteStructure
    | KeepMirrors
    | PublishTables
    | LimitEnded
    | WriteClockSamples
    | AdoptSession
    | ProveSession
    | ReportDuplicate
    | ReportDuplicateGone
    | ReportSlowdown
    | ReportUnsignedValues
    | ReportImpersonation
    | LinkChanged
    | MediumChanged
    | SendRoster
    | ApplyRoster
)
