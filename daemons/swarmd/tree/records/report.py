"""Report of the tree's work: the boards `tree/stats` and `tree/losses`."""

import logging
from collections.abc import Mapping

from swarmd.tree.core.tree import SwarmTree
from swarmd.tree.exchange.boundary import Boundary
from swarmd.tree.exchange.mirrors import Mirrors
from swarmd.tree.exchange.tree_exchange import TreeExchange
from swarmd.tree.records.denial_log import DenialLog
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.channel import ChannelStates, ListChannels
from swarmware.types.tree_exchange import StreamLoss, StreamLosses, TreeStats

log = logging.getLogger("swarm.tree")


class RateLog:
    """Compares the limited streams with the limited streams of the last report."""

    def __init__(self) -> None:
        self._limited: frozenset[tuple[str, str]] = frozenset()
        """Path and subscriber."""

    def record(self, limited: Mapping[tuple[str, str], tuple[float, str]]) -> None:
        """The streams that are limited now, by path and subscriber: the rate in Hz and the reason."""
        for path, platform in sorted(self._limited.difference(limited)):
            log.info("%s to %s: the link carries all of it again, or its rate is set", path, platform)
        # only transitions: the rate itself changes several times a second
        for (path, platform), (rate_hz, reason) in limited.items():
            if (path, platform) not in self._limited:
                log.info("%s to %s: the link carries %.1f/s (%s)", path, platform, rate_hz, reason)
        self._limited = frozenset(limited)


class TreeReport:
    """Writes the counters of the tree, and the losses when they change."""

    def __init__(
        self,
        module: Module,
        tree: SwarmTree,
        exchange: TreeExchange,
        mirrors: Mirrors,
        boundary: Boundary,
        denials: DenialLog,
    ) -> None:
        self._module = module
        self._denials = denials
        self._tree = tree
        self._exchange = exchange
        self._mirrors = mirrors
        self._boundary = boundary
        self._stats: BoardWriter[TreeStats] = module.writer(
            "tree/stats", TreeStats, rate_hz=1.0, link="request"
        )
        self._losses: BoardWriter[StreamLosses] = module.writer("tree/losses", StreamLosses, link="request")
        self._written = StreamLosses()
        # once at the start: an empty list is readable, a board without a value is not
        self._losses.write(self._written)
        self._rates = RateLog()

    def serve(self) -> None:
        """Registers the handler of the request."""
        self._module.serve("sys/tree/channels", ListChannels, self._channels, reply=ChannelStates)

    def _channels(self, request: ListChannels, _meta: object) -> ChannelStates:
        found = self._tree.subscribers.channels(self._module.now_ns(), every=request.all)
        return ChannelStates(found, self._exchange.coder.states())

    def write(self) -> None:
        """Write the present counters, and record rates that have changed."""
        self._stats.write(self._counters())
        losses = sorted(self._tree.subscribers.losses().items())
        found = StreamLosses(tuple(StreamLoss(path, platform, items) for (path, platform), items in losses))
        # written on change only: losses are rare, and each write is logged
        if found != self._written:
            self._written = found
            self._losses.write(found)

        self._rates.record(self._tree.subscribers.adapted())

    def _counters(self) -> TreeStats:
        tree, exchange, subscribers = self._tree, self._exchange, self._tree.subscribers
        sync = tree.replicas.sync()
        return TreeStats(
            resources=len(tree.local.index),
            platforms=sum(1 for replica in tree.replicas if replica.index is not None),
            requests_sent=exchange.asked,
            requests_answered=exchange.answered,
            subscribers=len(subscribers.platforms()),
            feeds=subscribers.feeds,
            notifications_sent=subscribers.notifications,
            values_sent=subscribers.values,
            notifications_received=exchange.notified,
            values_received=self._mirrors.written,
            notify_failures=subscribers.failures,
            events_dropped=subscribers.dropped,
            refused=self._boundary.refused,
            digest=tree.local.digest,
            followed=sync.followed,
            structures=sync.structures,
            subscriptions=sync.subscriptions,
            denied=self._denials.count,
        )
