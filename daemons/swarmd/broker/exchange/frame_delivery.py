"""Delivers authenticated frames of other platforms to applications here: in time, and with the right to."""

import logging
from collections.abc import Mapping
from functools import partial
from typing import Final

from swarmd.broker.core.broker import BrokerCore
from swarmd.broker.core.frames.end_to_end import AuthenticatedFrame
from swarmd.broker.core.membership.access_filter import AccessFilter
from swarmd.broker.core.traffic import FrameAccounts
from swarmd.broker.exchange.unit_delay import UnitDelays
from swarmware.errors import Denied, WireError
from swarmware.model.access import Access, Role, Verb
from swarmware.model.frame import FrameKind
from swarmware.transport.appfile.table import AppTable
from swarmware.transport.delivery.answer import answerable, expired, lifetime_ns
from swarmware.transport.delivery.outcome import ABSENT, Status
from swarmware.transport.delivery.sender import sender_of
from swarmware.transport.messaging.endpoint import MessageEndpoint
from swarmware.transport.security.denial_reporter import DenialReporter
from swarmware.transport.security.keys import Keys

LATE: Final = "late"
"""Verb of a denial: the command arrived after its lifetime."""

log = logging.getLogger("swarm.broker")


class FrameDelivery:
    """The last step of a frame for this node: its age, the right of its sender, its application."""

    def __init__(
        self,
        keys: Keys,
        messaging: MessageEndpoint,
        table: AppTable,
        core: BrokerCore,
        accounts: FrameAccounts,
        access: Access,
        denials: DenialReporter,
        delay: UnitDelays | None,
    ) -> None:
        """`delay`: simulated delay of frames from other units of this platform, or None without."""
        self._keys = keys
        self._messaging = messaging
        self._table = table
        self._core = core
        self._counters = core.counters
        self._accounts = accounts
        self._access_filter = AccessFilter(
            core.identity.platform, None if keys.roster is None else keys.roster.roles(), access
        )
        self._denials = denials
        self._delay = delay

    def set_roles(self, roles: Mapping[str, Role]) -> None:
        """Takes the roles of another roster."""
        self._access_filter.set_roles(roles)

    def on_arrival(self, arrival: AuthenticatedFrame) -> None:
        """Delivers a frame, or refuses it."""
        sender_hw, identity = arrival.frame.sender_hw, self._core.identity
        if self._delay is not None and self._core.nodes.platform(sender_hw) == identity.platform:
            self._delay.hold(sender_hw, partial(self._deliver, arrival))
        else:
            self._deliver(arrival)

    def _deliver(self, arrival: AuthenticatedFrame) -> None:
        frame = arrival.frame
        if self._is_late(arrival) or not self._may_pass(arrival):
            return
        self._messaging.deliver(frame)
        for channel, size in self._accounts.channels(frame):
            channel.received(size)
        if arrival.first:
            self._accounts.answered(frame)
            self._counters.notifications += self._accounts.values(frame)
            self._counters.requests += frame.kind is FrameKind.REPLY

    def _is_late(self, arrival: AuthenticatedFrame) -> bool:
        """Whether a neighbour's message or request has expired, or its age is not known.

        The sender has reported the first one; it repeats the second one, and its next beacon shows its clock.
        """
        frame, now_ns = arrival.frame, arrival.arrived_ns
        if not answerable(frame):
            return False
        clock_ns = self._core.clock_bound_ns(frame.sender_hw, now_ns)
        if clock_ns is None:
            # the age of a frame that others forwarded is judged with its signature
            is_undated = not arrival.path and lifetime_ns(frame.extension) is not None
            self._counters.refused.undated += is_undated
            return is_undated
        if not expired(frame, clock_ns):
            return False
        self._counters.refused.expired += 1
        platform, path = self._core.nodes.platform(frame.sender_hw), self.path_of(frame.data_id) or ""
        self.report_denial(platform, LATE, path, f"{path}: of {platform}, arrived after its lifetime", now_ns)
        return True

    def _may_pass(self, arrival: AuthenticatedFrame) -> bool:
        frame, arrived_ns = arrival.frame, arrival.arrived_ns
        platform = self._core.nodes.platform(frame.sender_hw)
        asks = answerable(frame)
        path = self.path_of(frame.data_id) if asks else None  # an answer needs no right
        if path is None and asks and not self._keys.is_open:
            # also when an application is about to state it: without its path no right can be checked
            self._messaging.refuse(frame, Status.ABSENT, ABSENT)
            return False
        try:
            via = tuple(map(self._core.nodes.platform, arrival.path))
            self._access_filter.check(frame, platform, path, arrived_ns, via)
        except WireError as error:
            self._counters.refused.malformed += 1
            log.debug("frame of %s: %s", platform, error)
            return False
        except Denied as error:
            self._counters.refused.denied += 1
            self._messaging.deny(frame, str(error))
            sender = sender_of(frame.extension)
            name = "" if sender is None else sender.caller
            self.report_denial(platform, Verb.CALL, path or "", str(error), arrived_ns, name, via)
            return False
        return True

    def report_denial(
        self,
        platform: str,
        verb: str,
        path: str,
        reason: str,
        now_ns: int,
        caller: str = "",
        via: tuple[str, ...] = (),
    ) -> None:
        """Counts a refusal, and reports it at a limited rate."""
        denial = self._access_filter.denied(platform, verb, path, reason, caller, via)
        self._denials.on_denial(denial, now_ns)

    def path_of(self, data_id: int) -> str | None:
        """Path that an application of this node serves, or None if no application serves it."""
        path = self._table.path_of(data_id)
        if path is None:
            self._table.refresh()
            path = self._table.path_of(data_id)
        return path

    def close(self) -> None:
        """Drops the frames that are delayed."""
        if self._delay is not None:
            self._delay.close()
