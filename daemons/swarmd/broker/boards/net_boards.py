"""Boards and streams that the broker writes: neighbours, routes, traffic, limits, denials, clock samples."""

from typing import Final

from swarmware.module.module import Module
from swarmware.types.channel import ChannelLimits
from swarmware.types.net import Denial, Neighbours, Routes, StructureBroadcast
from swarmware.types.outage import NodeLinks, OutageTable
from swarmware.types.time import TimingBatch
from swarmware.types.traffic import Traffic

TIMING_SLOTS: Final = 64
TIMING_SLOT_BYTES: Final = 4096
STRUCTURE_SLOTS: Final = 64
"""Structures that may arrive before the tree reads them; a lost structure is asked for again."""
STRUCTURE_SLOT_BYTES: Final = 2048
"""More than a beacon holds."""


class NetBoards:
    """The writers of `net/*`."""

    def __init__(self, module: Module) -> None:
        self.neighbours = module.writer(
            "net/neighbours", Neighbours, rate_hz=1, link="request", description="Nodes received directly"
        )
        self.routes = module.writer(
            "net/routes", Routes, rate_hz=1, link="request", description="Nodes that can be reached"
        )
        self.traffic = module.writer(
            "net/traffic",
            Traffic,
            rate_hz=1,
            link="request",
            log="1hz",
            description="Traffic counters in bytes",
        )
        self.links = module.writer(
            "net/links",
            NodeLinks,
            rate_hz=1,
            link="request",
            description="Links in a few numbers, for health rules",
        )
        self.outages = module.writer(
            "net/outages",
            OutageTable,
            link="request",
            log="1hz",
            description="Outages of links, the newest first",
        )
        self.limits = module.writer(
            "net/limits", ChannelLimits, link="request", description="Rules of channels in force"
        )
        self.denials = module.stream_writer(
            "net/denials", Denial, kind="event", log="all", description="Requests denied by access control"
        )
        self.timing = module.stream_writer(
            "net/timing",
            TimingBatch,
            slots=TIMING_SLOTS,
            slot_bytes=TIMING_SLOT_BYTES,
            description="Clock differences measured from datagrams",
        )
        self.structures = module.stream_writer(
            "net/structures",
            StructureBroadcast,
            slots=STRUCTURE_SLOTS,
            slot_bytes=STRUCTURE_SLOT_BYTES,
            description="Structures of neighbours' trees from their beacons",
        )
