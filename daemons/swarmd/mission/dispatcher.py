"""From one instruction to an order for each platform: roles, concurrent sending, receipts, all or none."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine, Iterable
from typing import Any

import msgspec

from swarmd.mission.checking import Checker, refuse
from swarmd.mission.config import Config
from swarmd.mission.store import MissionStore
from swarmware.errors import MissionError, NotFound, SwarmError
from swarmware.mission.assignment import Assignment, MemberAssignment, Platform, assign
from swarmware.mission.folder import Folder, files_hash, from_files
from swarmware.mission.loader import priority_of
from swarmware.mission.model import PRIORITIES, content_hash
from swarmware.mission.reaction import encode_rows
from swarmware.model.access import Sender
from swarmware.model.clock import utc_ns
from swarmware.model.names import join, natural
from swarmware.model.platform_kind import VEHICLES
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.mission import (
    LeftOut,
    MissionAbort,
    MissionOrder,
    MissionPlan,
    MissionReceipt,
    MissionTask,
    OrderReceipt,
    PriorityChange,
    TaskAnswer,
)

log = logging.getLogger("swarm.mission")

ORDER_PATH = "cmd/mission"
ABORT_PATH = "cmd/abort"
PRIORITY_PATH = "cmd/priority"
UNSEEN_NS = 3_000_000_000
"""Time in which the states of members may not show yet that they keep a run: three heartbeats."""

Accept = Callable[[MissionOrder, int, str | None, str], MissionReceipt | Awaitable[MissionReceipt]]
"""Accepts an order that arrived at this instant of the own clock, of this platform (None: not
authenticated) and this user."""


class Dispatcher:
    """Sends a mission as orders to the members of an ensemble."""

    def __init__(
        self,
        module: Module,
        config: Config,
        store: MissionStore,
        checker: Checker,
        receipts: BoardWriter[OrderReceipt],
        accept: Accept,
    ) -> None:
        self._module = module
        self._config = config
        self._store = store
        self._checker = checker
        self._receipts = receipts
        self._accept = accept
        """Accepts the order of this platform itself, without a network."""
        self._ordered: dict[int, tuple[tuple[str, ...], int]] = {}
        """Members of the newest runs, and when they were ordered."""

    async def plan(self, task: MissionTask, platforms: list[Platform], absent: list[LeftOut]) -> MissionPlan:
        """The assignment of roles for an instruction, without sending an order.

        Raises: as `task`.
        """
        folder, warnings = await self._checked(task)
        assignment = await self._assigned(task, folder, platforms, absent)
        left_out = _left_out(task, assignment, platforms, absent)
        return MissionPlan(folder.manifest.name, folder.hash, assignment.members, left_out, warnings)

    async def task(
        self,
        task: MissionTask,
        platforms: list[Platform],
        absent: list[LeftOut],
        instructed_ns: int,
        by: Sender | None = None,
    ) -> TaskAnswer:
        """Checks the mission, sends orders to all members concurrently, withdraws them unless all accept.

        `by`: user of this computer that gives the task; the members apply and record its role and name.
        Raises: MissionError, NotFound, ConfigError; then no order was sent.
        """
        low, high = PRIORITIES
        if task.priority is not None and not low <= task.priority <= high:
            raise MissionError(f"priority {task.priority}: expected a number from {low} to {high}")
        folder, warnings = await self._checked(task)
        assignment = await self._assigned(task, folder, platforms, absent)
        epoch = utc_ns() // 1_000_000 & 0xFFFF_FFFF or 1
        # the own order needs no link: it is checked after the other orders were sent
        members = sorted(
            assignment.member_assignments, key=lambda one: one.member.platform == self._module.platform
        )
        rows = encode_rows(folder.manifest.reaction)
        # the same at all members: they call the runs in their queues in one order
        own = max(priority_of(text) for text in folder.texts.values())
        priority = own if task.priority is None else task.priority
        hashes = {file: content_hash(text) for file, text in folder.texts.items()}
        orders = [
            (
                one.member.platform,
                msgspec.structs.replace(
                    self._order(folder, assignment, one, epoch, hashes[one.file], rows), priority=priority
                ),
            )
            for one in members
        ]
        with self._module.node.messaging.batch():
            answers = [self._send(order, platform, by) for platform, order in orders]
        receipts = await asyncio.gather(*answers)
        accepted = all(receipt.accepted for receipt in receipts)
        name = folder.manifest.name
        if accepted:
            log.info("mission %s: ordered from %d members", name, len(receipts))
        else:
            refused = [receipt.platform for receipt in receipts if not receipt.accepted]
            log.warning("mission %s: not accepted by %s; withdrawn", name, ", ".join(refused))
            reason = f"not accepted by {', '.join(refused)}"
            platforms_ordered = tuple(receipt.platform for receipt in receipts)
            await self.send_all(ABORT_PATH, platforms_ordered, MissionAbort(reason, epoch=epoch), by)
        if accepted:
            names = tuple(receipt.platform for receipt in receipts)
            self._ordered[epoch] = names, self._module.now_ns()
        self._publish(receipts)
        left_out = _left_out(task, assignment, platforms, absent)
        return TaskAnswer(
            name, folder.hash, epoch, accepted, tuple(receipts), left_out, instructed_ns, warnings
        )

    def _publish(self, receipts: Iterable[OrderReceipt]) -> None:
        """Publishes them when all are there: members of one computer share its time with this platform."""
        for receipt in receipts:
            if receipt.platform != self._module.platform:
                # the own order crossed no link: it would improve the statistics of delays
                self._receipts.write(receipt)

    def just_ordered(self, epoch: int) -> tuple[str, ...]:
        """Members of a run whose states may not show it yet."""
        now_ns = self._module.now_ns()
        self._ordered = {run: one for run, one in self._ordered.items() if now_ns - one[1] < UNSEEN_NS}
        return self._ordered.get(epoch, ((), 0))[0]

    async def send_all(
        self,
        path: str,
        platforms: tuple[str, ...],
        order: MissionAbort | PriorityChange,
        by: Sender | None = None,
    ) -> tuple[str, ...]:
        """Sends a message to all these platforms; returns those that did not acknowledge it."""
        timeout_s, send = self._config.order_timeout_s, self._module.send
        async with asyncio.TaskGroup() as group:
            with self._module.node.messaging.batch():
                sends = [
                    group.create_task(
                        send(
                            join(platform, path),
                            order,
                            timeout_s=timeout_s,
                            urgent=True,
                            on_behalf_of=by,
                        ),
                        name=f"mission: {path} of {platform}",
                    )
                    for platform in platforms
                ]
                await asyncio.sleep(0)  # each has made its frame
        outcomes = [each.result() for each in sends]
        return tuple(
            platform for platform, outcome in zip(platforms, outcomes, strict=True) if not outcome.delivered
        )

    async def _checked(self, task: MissionTask) -> tuple[Folder, tuple[str, ...]]:
        """The checked mission, and the warnings about it."""
        folder = self._sent(task) if task.files else self._store.folder(task.name)
        findings = await self._checker.check(folder)
        refuse(findings)
        return folder, tuple(map(str, findings))

    async def _assigned(
        self, task: MissionTask, folder: Folder, platforms: list[Platform], absent: list[LeftOut]
    ) -> Assignment:
        """The assignment of roles; the values of parameters are checked with the text of each role."""
        assignment = assign(folder, self._chosen(task, platforms, absent), task.params)
        if task.params:  # the defaults were checked with the folder
            await self._checker.check_params(folder, assignment)
        return assignment

    def _sent(self, task: MissionTask) -> Folder:
        """The mission whose files a task contains; a stored one of equal content is not parsed again."""
        stored = self._store.known(files_hash(task.files))
        if stored is None:
            return from_files(task.files, task.name, self._checker.catalogue)
        return msgspec.structs.replace(stored, where=task.name)

    @staticmethod
    def _chosen(task: MissionTask, platforms: list[Platform], absent: list[LeftOut]) -> list[Platform]:
        known = {platform.name: platform for platform in platforms}
        reasons = {left.platform: left.why for left in absent}
        for name in task.members:
            if name in reasons:
                raise MissionError(f"platform {name!r}: cannot take part: {reasons[name]}")
            if name not in known:
                raise NotFound(f"platform {name!r}: not known here; expected some of {', '.join(known)}")
        return [known[name] for name in task.members] if task.members else platforms

    def _order(
        self,
        folder: Folder,
        assignment: Assignment,
        member: MemberAssignment,
        epoch: int,
        text_hash: str,
        rows: str,
    ) -> MissionOrder:
        now_ns = self._module.now_ns()
        return MissionOrder(
            mission=folder.manifest.name,
            hash=folder.hash,
            epoch=epoch,
            role=member.member.role,
            file=folder.place(member.file),
            text=folder.texts[member.file],
            text_hash=text_hash,
            members=assignment.members,
            params=member.binding.params,
            issuer=self._module.platform,
            issued_ns=now_ns,
            expires_ns=now_ns + round(self._config.order_expiry_s * 1e9),
            reactions=rows,
        )

    def _send(
        self, order: MissionOrder, platform: str, by: Sender | None
    ) -> Coroutine[Any, Any, OrderReceipt]:
        """Sends the order before it returns; the coroutine waits for the reply."""
        sent_ns = self._module.now_ns()
        if platform == self._module.platform:
            return self._receipt(order, platform, sent_ns, self._own(order, sent_ns, str(by or platform)))
        path, timeout_s = join(platform, ORDER_PATH), self._config.order_timeout_s
        try:
            answer = self._module.request(
                path, order, MissionReceipt, timeout_s=timeout_s, urgent=True, on_behalf_of=by
            )
        except SwarmError as error:
            return self._receipt(order, platform, sent_ns, error)
        return self._receipt(order, platform, sent_ns, answer)

    async def _own(self, order: MissionOrder, sent_ns: int, by: str) -> MissionReceipt:
        """Accepts the order of this platform itself, when the other orders have been sent."""
        receipt = self._accept(order, sent_ns, None, by)
        return receipt if isinstance(receipt, MissionReceipt) else await receipt

    async def _receipt(
        self,
        order: MissionOrder,
        platform: str,
        sent_ns: int,
        answer: Awaitable[MissionReceipt] | SwarmError,
    ) -> OrderReceipt:
        reasons: tuple[str, ...] = ()
        receipt: MissionReceipt | None = None
        try:
            if isinstance(answer, SwarmError):
                raise answer
            receipt = await answer
        except SwarmError as error:
            reasons = (f"{type(error).__name__}: {error}",)
        return OrderReceipt(
            mission=order.mission,
            epoch=order.epoch,
            platform=platform,
            role=order.role,
            sent_ns=sent_ns,
            acked_ns=self._module.now_ns() if receipt else 0,
            received_ns=receipt.received_ns if receipt else 0,
            accepted=receipt is not None and receipt.accepted,
            reasons=receipt.reasons if receipt else reasons,
            waits=receipt.waits if receipt else "",
        )


def _left_out(
    task: MissionTask, assignment: Assignment, platforms: list[Platform], absent: list[LeftOut]
) -> tuple[LeftOut, ...]:
    """Known platforms that take no part, with the reason; none where the instruction names the members."""
    if task.members:
        return ()
    kinds = {platform.name: platform.kind for platform in platforms}
    # a ground station is not expected to have a role
    spare = [name for name in assignment.left_out if kinds[name] in VEHICLES]
    found = [*(LeftOut(name, f"no role for a {kinds[name]}") for name in spare), *absent]
    return tuple(sorted(found, key=lambda left: natural(left.platform)))
