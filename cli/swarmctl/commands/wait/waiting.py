"""Waits until a condition on values of resources holds, by subscriptions."""

import asyncio
from typing import Final

import msgspec

from swarmctl.commands.wait.condition_watch import ConditionWatch, OperandValue
from swarmctl.resources.access import find_entry
from swarmctl.resources.classes import known_class
from swarmctl.resources.newest import newest
from swarmctl.session.session import Session
from swarmware.errors import NoAnswer, NotFound, WireError
from swarmware.model import names
from swarmware.model.frame import Frame
from swarmware.model.resource import Kind
from swarmware.runtime.instant import until
from swarmware.types import registry
from swarmware.types.tree import Quality, TreeEntry

RETRY_NS: Final = 50_000_000
"""Period of the question for the type of a resource whose first value is here: an application describes it in
the same turn, and the tree reads that within milliseconds."""
PRESENT: Final = frozenset({Kind.BOARD, Kind.SETTING})
"""Kinds with a present value; of events and streams only new items count."""


class ConditionReached(msgspec.Struct, frozen=True):
    """A condition that holds."""

    path: str
    condition: str
    after_s: float
    """Time from the begin of the wait."""
    operands: list[OperandValue]
    """Values with which it holds."""


async def wait_until(session: Session, path: str, text: str, wait_s: float) -> None:
    """Returns when the condition holds, and prints the values with which it does.

    Raises: MissionError or InvalidInput for an invalid condition, NoAnswer with the last values when the time
    is over.
    """
    full = names.check_path(session.path(path))
    watch = ConditionWatch(full, text)
    wait = _Wait(session, watch)
    began_ns = session.module.now_ns()
    try:
        async with asyncio.timeout(wait_s), asyncio.TaskGroup() as tasks:
            followers = [
                tasks.create_task(wait.follow(one), name=f"wait for {one}") for one in sorted(watch.paths)
            ]
            reached = await wait.reached()
            for task in followers:
                task.cancel()
    except TimeoutError:
        shown = watch.shown(watch.operands(session.module.now_ns()))
        raise NoAnswer(f"{full}: {text}: not within {wait_s:g} s; last: {shown}") from None
    except ExceptionGroup as group:
        # the first error of a follower is the reason; the others were cancelled by it
        raise group.exceptions[0] from None
    after_s = (session.module.now_ns() - began_ns) / 1e9
    if session.settings.structured:
        session.out.document(ConditionReached(full, text, after_s, reached))
    else:
        session.out.text(f"{full}: {watch.shown(reached)} after {after_s:.1f} s")


class _Wait:
    """Gives a condition each value of its resources, and evaluates it then."""

    def __init__(self, session: Session, watch: ConditionWatch) -> None:
        self._session = session
        self._watch = watch
        self._changed = asyncio.Event()
        self._reached: list[OperandValue] | None = None

    async def reached(self) -> list[OperandValue]:
        """The values with which the condition holds, when it does."""
        module = self._session.module
        self._evaluate()
        while self._reached is None:
            self._changed.clear()
            try:
                async with asyncio.timeout(self._watch.next_change_s(module.now_ns())):
                    await self._changed.wait()
            except TimeoutError:
                self._evaluate()  # a value has the age that the condition names
        return self._reached

    def _evaluate(self) -> None:
        now_ns = self._session.module.now_ns()
        if self._reached is None and self._watch.holds(now_ns):
            self._reached = self._watch.operands(now_ns)
        self._changed.set()

    async def follow(self, path: str) -> None:
        """Takes each value of a resource, even if the resource appears later."""
        session = self._session
        # subscribed before the look-up, so that a value between the two is not missed
        reader = session.module.frame_reader(path, every=True)
        entry = await find_entry(session, path)
        first: Frame | None = None
        if entry is None or not entry.type:
            session.out.say(f"{path}: does not exist yet; waiting for it")
            first = await anext(reader)
            entry = await _appeared(session, path)
        cls = await known_class(session, names.split(path)[0] or session.here, entry.type)
        self._watch.on_entry(entry, cls)
        if first is not None:
            self._take(path, cls, first)
        elif entry.kind in PRESENT:
            await self._take_present(path, cls)
        async for frame in reader:
            self._take(path, cls, frame)

    def _take(self, path: str, cls: type[msgspec.Struct], frame: Frame) -> None:
        module = self._session.module
        stamp_ns: int | None = frame.stamp_ns
        if frame.sender_hw != module.node.hardware:
            stamp_ns = module.remote_clocks.to_local(frame.sender_hw, frame.stamp_ns)
        try:
            value = registry.decode(cls, frame.payload, frame.codec)
        except WireError as error:
            self._session.out.detail(f"{path}: a value is skipped: {error}")
            return
        self._watch.on_value(path, value, stamp_ns)
        self._evaluate()  # at each value, because a condition that holds only for a moment counts as well

    async def _take_present(self, path: str, cls: type[msgspec.Struct]) -> None:
        """The value in force now; a lost platform has none."""
        session = self._session
        try:
            found = await newest(session, path)
            value = registry.decode(cls, found.data)
        except (NotFound, NoAnswer, WireError):
            return  # no value yet
        # the last value of a lost platform says nothing about its present state
        if found.quality is Quality.LOST:
            session.out.say(f"{path}: lost; waiting for a new value")
            return
        age_ns = None if found.age_s is None else round(found.age_s * 1e9)
        self._watch.on_value(path, value, None if age_ns is None else session.module.now_ns() - age_ns)
        self._evaluate()


async def _appeared(session: Session, path: str) -> TreeEntry:
    """The resource whose first value is here."""
    clock = session.module.clock
    while (entry := await find_entry(session, path)) is None or not entry.type:
        await until(clock, clock.now_ns() + RETRY_NS)
    return entry
