"""Lines of `mission watch`: one per change with the time, or one per member that is redrawn on a terminal."""

from collections.abc import Mapping, Sequence
from typing import Final

import msgspec

from swarmctl.terminal.quantities import spoken
from swarmctl.terminal.table import Cell, Column, fitted_table
from swarmctl.terminal.table import show as shown
from swarmware.types.mission import ASKS, INACTIVE, MissionState

MOVING_M_S: Final = 0.2
"""Speed below which no time of arrival is estimated."""

COLUMNS: Final = (
    Column("PLATFORM"),
    Column("STATE"),
    Column("BLOCK"),
    Column("PROGRESS", right=True),
    Column("HEIGHT m", right=True, drop=1),
    Column("DISTANCE m", right=True),
    Column("ETA", right=True),
    Column("SINCE", right=True, drop=2),
)


class MemberProgress(msgspec.Struct, frozen=True):
    """What is known of a member, for its line on a terminal."""

    state: MissionState | None
    since_s: float
    """Since the last change of state or block."""
    height_m: float | None = None
    distance_m: float | None = None
    """Distance to the goal of its navigator."""
    speed_m_s: float = 0.0

    @property
    def eta_s(self) -> float | None:
        """Time to the goal at the present speed, or None if unknown or at rest."""
        if self.distance_m is None or self.speed_m_s < MOVING_M_S:
            return None
        return self.distance_m / self.speed_m_s


def display_key(state: MissionState) -> object:
    """Fields whose change is a line; the text of a block that runs changes with each metre."""
    return state.state, state.mission, state.active, _lasting_text(state)


def _lasting_text(state: MissionState) -> str:
    """The reason of an end, or the question to the operator; "" for the text of a motion."""
    return state.text if state.state in INACTIVE or ASKS in state.text else ""


def change_line(clock: str, platform: str, state: MissionState) -> str:
    """The line of one change: `14:03:22 uav1 formation running takeoff`."""
    text, blocks = _lasting_text(state), ", ".join(state.active)
    return f"{clock} {platform:<8} {state.mission:<12} {state.state:<10} {blocks:<24} {text}".rstrip()


def member_table(
    mission: str, elapsed_s: float, members: Mapping[str, MemberProgress], width: int | None = None
) -> str:
    """The lines of all members under a title with the time since the command."""
    cells: list[Sequence[str]] = [[shown(cell) for cell in _row(*item)] for item in members.items()]
    return f"{mission} {spoken(elapsed_s)}\n{fitted_table(COLUMNS, cells, width).text}"


def _row(platform: str, member: MemberProgress) -> tuple[Cell, ...]:
    state = member.state
    if state is None:
        return platform, "no state yet", *[None] * 5, spoken(member.since_s)
    ended = state.state in INACTIVE
    return (
        platform,
        state.state,
        state.text if ended else _lasting_text(state) or ", ".join(state.active),
        f"{state.progress_ratio:.0%}",
        None if member.height_m is None else f"{member.height_m + 0.0:.1f}",
        None if member.distance_m is None or ended else f"{member.distance_m:.1f}",
        None if member.eta_s is None or ended else spoken(member.eta_s),
        spoken(member.since_s),
    )
