"""Acceptance of orders: an order whose mission was read before is answered in the call that brings it."""

import logging
from collections.abc import Awaitable, Callable
from contextlib import suppress

import msgspec

from swarmd.mission.checking import Checker
from swarmd.mission.core.admission import OrderAdmission
from swarmd.mission.core.run import Announce, Run
from swarmd.mission.core.scheduler import MissionScheduler
from swarmd.mission.drain import Drain
from swarmd.mission.values import Values
from swarmware.errors import SwarmError
from swarmware.mission.binding import Binding
from swarmware.mission.finding import Finding
from swarmware.mission.model import MissionDefinition
from swarmware.model.names import hardware_id
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.module import Module
from swarmware.types import registry
from swarmware.types.mission import MissionOrder, MissionReceipt

log = logging.getLogger("swarm.mission")

Check = Callable[[MissionOrder, MissionDefinition], None]
"""Checks the order against reactions and fence. Raises: SwarmError."""


class OrderAcceptance:
    """Decides about orders and answers them.

    All members of an ensemble get their orders at the same time, and on a shared computer each waits for the
    processor time of the others. So a mission that was read before costs neither a task nor another
    iteration of the event loop.
    """

    def __init__(
        self,
        module: Module,
        kind: PlatformKind,
        checker: Checker,
        values: Values,
        drain: Drain,
        core: MissionScheduler,
        check: Check,
        take: Callable[[Run, MissionOrder, tuple[Finding, ...]], None],
    ) -> None:
        """`take`: passes the run of an accepted order on, with the findings of its check. Raises:
        SwarmError."""
        self._module = module
        self._admission = OrderAdmission(module.platform, kind)
        self._checker = checker
        self._values = values
        self._drain = drain
        self._core = core
        self._check = check
        self._take = take

    def on_order(
        self, order: MissionOrder, received_ns: int, sender: str | None, by: str
    ) -> MissionReceipt | Awaitable[MissionReceipt]:
        """The receipt of an order, or the wait for it while its mission is read.

        `sender`: the platform that sent it, or None if it is not authenticated; `by`: name of the sender.
        """
        if self._has_taken(order):
            return MissionReceipt(True, received_ns)
        try:
            expires_ns = self._expiry(order, received_ns)
            binding = self._admission.verify(order, received_ns, expires_ns, sender, self._drain.by)
            mission = self._checker.known(order.text, order.file, binding)
        except SwarmError as error:
            return _refusal(order, received_ns, error)
        if mission is None:
            return self._read(order, binding, received_ns, by)
        return self._decide(order, mission, binding, received_ns, by)

    async def _read(self, order: MissionOrder, binding: Binding, received_ns: int, by: str) -> MissionReceipt:
        try:
            mission = await self._checker.load(order.text, order.file, binding)
        except SwarmError as error:
            return _refusal(order, received_ns, error)
        if self._has_taken(order):  # accepted meanwhile by a repeated request
            return MissionReceipt(True, received_ns)
        return self._decide(order, mission, binding, received_ns, by)

    def _decide(
        self, order: MissionOrder, mission: MissionDefinition, binding: Binding, received_ns: int, by: str
    ) -> MissionReceipt:
        try:
            run = self._admission.run(order, mission)
            self._check(order, mission)
            self._values.open(mission.resources)
            findings = self._checker.warnings(order.text, binding)
            self._take(msgspec.structs.replace(run, by=by), order, findings)
        except SwarmError as error:
            return _refusal(order, received_ns, error)
        return MissionReceipt(True, received_ns, waits=self._core.waits(order.epoch))

    def rehearse(self, order: MissionOrder, mission: MissionDefinition, core: MissionScheduler) -> None:
        """Run the acceptance of an order without effect, on a core that is discarded.

        The first order then finds its code and tables in the memory of this process.
        """
        now_ns = self._module.now_ns()
        with suppress(SwarmError):  # a requirement may not be met yet
            binding = self._admission.verify(order, now_ns, self._expiry(order, now_ns), order.issuer)
            self._checker.known(order.text, order.file, binding)
            run = self._admission.run(order, mission)
            self._check(order, mission)
            for action in core.on_order(run, now_ns):
                if isinstance(action, Announce):
                    registry.encode(action.state)

    def _has_taken(self, order: MissionOrder) -> bool:
        """Whether the order was accepted before: its reply was lost or late, so it is sent again."""
        return self._core.keeps(order.epoch)

    def _expiry(self, order: MissionOrder, received_ns: int) -> int:
        local_ns = self._module.remote_clocks.to_local(hardware_id(order.issuer), order.expires_ns)
        # the issuer's clock is not known yet: the order is assumed to be new
        return received_ns + order.expires_ns - order.issued_ns if local_ns is None else local_ns


def _refusal(order: MissionOrder, received_ns: int, error: SwarmError) -> MissionReceipt:
    log.warning("mission %s of %s: refused: %s", order.mission, order.issuer, error)
    return MissionReceipt(False, received_ns, tuple(str(error).splitlines()))
