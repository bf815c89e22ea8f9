"""Reactions: conditions on resources that hold for a time, and the action that each causes."""

from collections.abc import Iterable
from typing import Final

import msgspec

from swarmware.errors import Conflict
from swarmware.mission.condition import ConditionExpression, Lookup
from swarmware.mission.condition_parser import parse
from swarmware.mission.model import CONTINUE
from swarmware.mission.reaction import LINK_LOSS, STRENGTH, WARN, ReactionRow
from swarmware.types.mission import MissionPhase
from swarmware.types.reaction import ReactionPhase, ReactionState

_IDLE, _PENDING, _ACTIVE = ReactionPhase.IDLE, ReactionPhase.PENDING, ReactionPhase.ACTIVE


LINK_LOST: Final = (
    "mission/watch.station == false"
    f" and not (mission/state.state == '{MissionPhase.RECOVERING}' and mission/state.mission == 'return')"
)
"""Condition of the row `link_loss`: a return that has begun continues, whatever the policy is."""


def link_loss_row(action: str, for_s: float) -> ReactionRow:
    """The row of a lost link with the policy in force."""
    return ReactionRow(
        name=LINK_LOSS,
        when=LINK_LOST,
        for_s=for_s,
        action=WARN if action == CONTINUE else action,  # type: ignore[arg-type]  # both are checked Literals
        where="any",
        says="no ground station in reach",
    )


class Situation(msgspec.Struct, frozen=True):
    """State of the vehicle that decides which rows apply."""

    armed: bool
    airborne: bool
    """Whether it flies now."""
    orders: int = 0
    """Number of orders of operators so far; a later order overrides a reaction, unless its row is lasting."""


class React(msgspec.Struct, frozen=True):
    """Take this action, unless a stronger one runs."""

    row: ReactionRow
    action: str
    reason: str

    @property
    def suspends(self) -> bool:
        """Whether the present mission continues afterwards."""
        return self.row.resume and self.action == self.row.action


class RowChanged(msgspec.Struct, frozen=True):
    """A row has become active or idle, for operators."""

    state: ReactionState
    values: str = ""
    """Values of the fields of its condition at this moment."""


ReactionAction = React | RowChanged


GAP_NS: Final = 1_500_000_000
"""Longest time between two evaluations that counts as observed: a node that did not run observes nothing."""


class _Entry:
    """One row and its phase."""

    def __init__(self, row: ReactionRow, note: str = "") -> None:
        self.row = row
        self.note = note
        self.phase = _IDLE
        self.since_ns = 0
        self.action: str = row.action
        self.reason = ""
        self.orders = 0
        """Number of orders when the action was taken."""
        self._when: ConditionExpression = parse(row.when)
        self._possible = parse(row.possible) if row.possible is not None else None
        self.resources = self._when.resources()
        if self._possible is not None:
            self.resources |= self._possible.resources()

    def applies(self, situation: Situation) -> bool:
        """Whether the row applies where the vehicle is."""
        if self.row.where != "any" and (self.row.where == "air") is not situation.airborne:
            return False
        return situation.armed

    def holds(self, lookup: Lookup) -> bool:
        """Whether the condition holds now; a condition with an unknown value does not hold."""
        return self._when.holds(lookup) is True

    def changed(self, lookup: Lookup) -> RowChanged:
        """The report that the row has changed, with the values that caused it."""
        return RowChanged(self.state(), self._when.values(lookup))

    def chosen(self, lookup: Lookup) -> str:
        """The action of the row, or its alternative if the action is not possible."""
        if self._possible is None or self._possible.holds(lookup) is True:
            return self.row.action
        return self.row.otherwise or self.row.action

    def why(self, now_ns: int) -> str:
        """The reason, with the time for which the condition has held."""
        reason = self.row.says or self.row.when
        if self.row.for_s:
            reason += f" for {(now_ns - self.since_ns) / 1e9:.0f} s"
        if self.action != self.row.action:
            reason += f"; {self.row.action} is not possible: not {self.row.possible}"
        return reason

    def state(self) -> ReactionState:
        """State of the row for operators."""
        return ReactionState(self.row.name, self.phase, self.action, self.since_ns, self.reason, self.note)


class ReactionTable:
    """Decides which rows are active, and which actions they cause.

    An active row keeps the definition with which it acted until it is idle again.
    """

    def __init__(self) -> None:
        self._entries: dict[str, _Entry] = {}
        self._looked_ns: int | None = None

    def set_rows(self, rows: Iterable[ReactionRow], notes: dict[str, str]) -> None:
        """Sets the rows in force. Of several rows with one name the first counts.

        `notes`: why a row of this name can never act.
        """
        before, self._entries = self._entries, {}
        for row in rows:
            entry = before.get(row.name)
            if row.name in self._entries:
                continue
            # a new definition of an active row waits until the row is idle: its action has been taken
            if entry is None or (entry.row != row and entry.phase is not _ACTIVE):
                entry = _renewed(row, entry)
            entry.note = notes.get(row.name, "")
            self._entries[row.name] = entry
        for name, entry in before.items():  # a row of an ended mission stays while it is active
            if name not in self._entries and entry.phase is _ACTIVE:
                self._entries[name] = entry

    def resources(self) -> frozenset[str]:
        """Paths of the resources in the conditions."""
        return frozenset(path for entry in self._entries.values() for path in entry.resources)

    def states(self) -> tuple[ReactionState, ...]:
        """State of each row."""
        return tuple(entry.state() for entry in self._entries.values())

    def on_look(self, lookup: Lookup, situation: Situation, now_ns: int) -> list[ReactionAction]:
        """Evaluates all rows; the strongest action comes first."""
        unseen_ns = 0 if self._looked_ns is None else max(now_ns - self._looked_ns - GAP_NS, 0)
        self._looked_ns = now_ns
        changes: list[RowChanged] = []
        reactions: list[React] = []
        for entry in self._entries.values():
            if entry.phase is _PENDING:
                entry.since_ns += unseen_ns  # the hold time counts only observed time
            acts = self._step(entry, lookup, situation, now_ns, changes)
            if acts and entry.action != WARN:
                entry.orders = situation.orders
                reactions.append(React(entry.row, entry.action, entry.reason))
        # the shell takes the actions in order, and a weaker one does not replace a stronger one
        reactions.sort(key=lambda one: -STRENGTH[one.action])
        return [*changes, *reactions]

    @staticmethod
    def _step(
        entry: _Entry, lookup: Lookup, situation: Situation, now_ns: int, changes: list[RowChanged]
    ) -> bool:
        """Moves a row to its next phase; returns whether its action is to be taken now."""
        if not (entry.applies(situation) and entry.holds(lookup)):
            if entry.phase is not _IDLE:
                was_active = entry.phase is _ACTIVE
                entry.phase, entry.since_ns, entry.reason = _IDLE, now_ns, ""
                if was_active:
                    changes.append(entry.changed(lookup))
                entry.action = entry.row.action
            return False
        if entry.phase is _IDLE:
            entry.phase, entry.since_ns, entry.reason = _PENDING, now_ns, entry.row.says or entry.row.when
        if entry.phase is _PENDING:
            if now_ns - entry.since_ns < entry.row.for_s * 1e9:
                return False
            entry.action = entry.chosen(lookup)
            entry.reason = entry.why(now_ns)
            entry.phase, entry.since_ns = _ACTIVE, now_ns
            changes.append(entry.changed(lookup))
            return True
        # From here on the row is active. A fall-back is taken when its action becomes impossible, and a
        # lasting row repeats its action after an order of an operator.
        overridden = entry.orders != situation.orders
        if entry.action == entry.row.action and entry.chosen(lookup) != entry.action and not overridden:
            entry.action = entry.chosen(lookup)
            entry.reason = f"{entry.row.says or entry.row.when}; {entry.row.action} is no longer possible"
            changes.append(entry.changed(lookup))
            return True
        return entry.row.lasting and overridden

    def check_order(self, order: str) -> None:
        """Check that no lasting reaction forbids a built-in mission, another manoeuvre, or a mission.

        Raises: Conflict with the reason of the reaction.
        """
        for entry in self._entries.values():
            if not (entry.row.lasting and entry.phase is _ACTIVE) or entry.action == WARN:
                continue
            if STRENGTH.get(order, 0) < STRENGTH[entry.action]:
                stronger = [name for name in STRENGTH if STRENGTH[name] >= STRENGTH[entry.action]]
                raise Conflict(
                    f"{order}: reaction {entry.row.name} is active ({entry.action}: {entry.reason}); expected"
                    f" {' or '.join(stronger)}, or to drive by hand"
                )


def _renewed(row: ReactionRow, before: _Entry | None) -> _Entry:
    """The entry of a row whose definition is new; the hold time of a pending row continues."""
    entry = _Entry(row)
    if before is not None and before.row.when == row.when and before.phase is _PENDING:
        entry.phase, entry.since_ns, entry.reason = before.phase, before.since_ns, before.reason
    return entry
