"""Denied requests of this node: as events, and in the record of changes."""

import logging
from typing import Final

from swarmd.tree.records.change_log import ChangeLog
from swarmware.errors import Denied
from swarmware.model import names
from swarmware.model.access import Sender, Verb
from swarmware.module.meta import Meta
from swarmware.module.module import DENIED, Module
from swarmware.transport.security.denial_reporter import DenialReporter
from swarmware.types.net import Denial
from swarmware.types.tree import TreeChange

RECORDED: Final = frozenset({Verb.CALL, Verb.SET, "late"})
"""Verbs of denials that the record of changes has."""

log = logging.getLogger("swarm.tree")


class DenialLog:
    """Writes the event `tree/denials`, and records the denials of the broker and of other processes."""

    def __init__(self, module: Module, changes: ChangeLog) -> None:
        self._module = module
        self._changes = changes
        self._reporter = DenialReporter(self._report)
        self._events = module.stream_writer(
            "tree/denials", Denial, kind="event", log="all", description="Changes denied by access control"
        )
        self._of_broker = module.stream_reader("net/denials", Denial)
        self._of_processes = module.inbox(DENIED, Denial)
        self.count = 0
        """Number of requests that this tree denied."""

    def check(self, meta: Meta, verb: Verb, path: str) -> None:
        """Checks the rights of a sender, and reports a denial. Raises: Denied."""
        try:
            self._module.node.access_rules.access.check(meta.sender, verb, path)
        except Denied as error:
            assert meta.sender is not None
            self.record(meta.sender, verb, path, str(error))
            raise

    def record(self, sender: Sender, verb: Verb, path: str, reason: str) -> None:
        """Report a denial of this tree; the record of changes has it already."""
        # counted before the report, which is limited in its rate
        self.count += 1
        denial = Denial(
            sender.platform, sender.role.name.lower(), str(verb), path, 1, reason, sender.caller, sender.via
        )
        self._reporter.on_denial(denial, self._module.now_ns())

    def _report(self, report: Denial) -> None:
        log.warning("denied: %s", report.reason)
        self._events.write(report)

    def close(self) -> None:
        """End the reports of denials."""
        self._reporter.close()

    async def follow_broker(self) -> None:
        """Record the requests that the broker denied, until cancelled."""
        # the broker has written its event already, so only the record is missing
        async for denial in self._of_broker:
            if denial.verb in RECORDED and denial.path:
                await self._changes.record(recorded(self._module.platform, denial))

    async def follow_processes(self) -> None:
        """Report and record the requests of users of this computer that its processes denied, until
        cancelled."""
        async for denial in self._of_processes:
            self._events.write(denial)
            if denial.verb in RECORDED and denial.path:
                await self._changes.record(recorded(self._module.platform, denial))


def recorded(platform: str, denial: Denial) -> TreeChange:
    """The line of a denial in the record of changes of a platform."""
    reason = denial.reason if denial.count == 1 else f"{denial.reason} ({denial.count} times)"
    return TreeChange(
        names.join(platform, denial.path),
        f"{denial.caller or denial.role}@{denial.platform}",
        "",
        "",
        reason,
        denial.via,
    )
