"""Rows of reactions: a condition, and what a vehicle does when it has held for a time."""

from collections.abc import Iterable, Iterator
from typing import Annotated, Final, Literal

import msgspec

from swarmware.errors import InvalidInput
from swarmware.mission.condition_parser import parse

Action = Literal["warn", "mission", "hold", "return", "land", "emergency-land"]
"""Action of a reaction: a warning, a stored mission, or a built-in mission."""

WARN: Final = "warn"
STORED: Final = "mission"
STRENGTH: Final[dict[str, int]] = {WARN: 0, STORED: 0, "hold": 1, "return": 2, "land": 3, "emergency-land": 4}
"""Strength of the actions: a weaker action never replaces a running stronger one."""

LINK_LOSS: Final = "link_loss"
"""Row of a lost link, whose action and hold time are settings."""

Condition = Annotated[str, msgspec.Meta(max_length=500)]
"""A condition on resources, as in missions."""


class ReactionRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One reaction: a condition, its hold time, and the action."""

    name: Annotated[
        str,
        msgspec.Meta(
            pattern=r"^[a-z][a-z0-9_-]{0,30}$",
            description="a name of lower-case letters, digits, _ and -, such as battery_low",
        ),
    ]
    """Name of the row, unique in the table."""
    when: Condition
    """Condition on resources, in the language of missions. An unknown value never causes a reaction."""
    for_s: Annotated[float, msgspec.Meta(ge=0, le=86_400)] = 0.0
    """Hold time: time for which the condition must hold without a break."""
    action: Action
    """Action: a warning, a stored mission, or a built-in mission, which ends the present one."""
    mission: Annotated[str, msgspec.Meta(max_length=64)] = ""
    """Name of the stored mission, for the action `mission`."""
    priority: Annotated[int, msgspec.Meta(ge=0, le=99)] = 50
    """Priority of the stored mission: it suspends a mission of lower priority."""
    resume: bool = False
    """Whether the built-in mission suspends the present mission in place of ending it; the mission continues
    when the built-in mission has ended and the condition does not hold any more."""
    where: Literal["air", "ground", "any"] = "air"
    """Where the row applies; to a vehicle with armed motors only."""
    lasting: bool = False
    """Whether the action stays in force while the condition holds: weaker orders are refused then. Otherwise
    it is taken once, and an order that follows stands."""
    possible: Condition | None = None
    """Condition under which the action is possible; without it, the action always is."""
    otherwise: Action | None = None
    """Stronger action where `possible` does not hold, or is unknown."""
    says: Annotated[str, msgspec.Meta(max_length=100)] = ""
    """Reason for operators, or "" to show the condition."""

    def __post_init__(self) -> None:
        """Check the conditions, and constraints between fields."""
        for key, text in (("when", self.when), ("possible", self.possible)):
            if text is not None:
                try:
                    parse(text)
                except InvalidInput as error:
                    raise InvalidInput(f"reaction {self.name}, key {key}: {error}") from error
        # an action that is not possible needs another one, else nothing would happen
        if (self.action == STORED) != bool(self.mission):
            raise InvalidInput(
                f"reaction {self.name}: `mission` names the mission of the action 'mission'; expected both or"
                " none"
            )
        if self.resume and (self.lasting or self.action not in {"hold", "return"}):
            raise InvalidInput(
                f"reaction {self.name}: `resume` is possible for hold and return without `lasting`; expected"
                " such an action"
            )
        if (self.possible is None) != (self.otherwise is None):
            raise InvalidInput(
                f"reaction {self.name}: `possible` and `otherwise` belong together; expected both or none"
            )
        # the fallback is for a worse case, so it must do more
        if self.otherwise is not None and STRENGTH[self.otherwise] <= STRENGTH[self.action]:
            stronger = [action for action in STRENGTH if STRENGTH[action] > STRENGTH[self.action]]
            expected = f"one of {', '.join(stronger)}" if stronger else "none: no action is stronger"
            raise InvalidInput(
                f"reaction {self.name}: otherwise = {self.otherwise!r} is not stronger than {self.action!r};"
                f" expected {expected}"
            )


def misnamed(rows: Iterable[ReactionRow]) -> Iterator[tuple[int, str]]:
    """Number and error of each row of a table that may not have its name."""
    seen: set[str] = set()
    for number, row in enumerate(rows):
        if row.name == LINK_LOSS:
            yield (
                number,
                f"row {LINK_LOSS!r} is set by the keys link_loss and link_loss_s, and by on_link_loss of a"
                " role's file; expected another name",
            )
        elif row.name in seen:
            yield number, f"{row.name!r} is a row already; expected unique names"
        seen.add(row.name)


def encode_rows(rows: tuple[ReactionRow, ...]) -> str:
    """The rows as a JSON array, or "" without rows."""
    return msgspec.json.encode(rows).decode() if rows else ""


def decode_rows(text: str) -> tuple[ReactionRow, ...]:
    """The rows in a JSON array, or none in an empty text.

    Raises: InvalidInput for any other text.
    """
    if not text:
        return ()
    try:
        rows = msgspec.json.decode(text, type=tuple[ReactionRow, ...])
    except (msgspec.DecodeError, ValueError) as error:
        raise InvalidInput(f"reactions: {error}") from error
    for _, message in misnamed(rows):
        raise InvalidInput(f"reactions: {message}")
    return rows
