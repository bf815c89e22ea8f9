"""Settings of the mission daemon (services/mission.toml)."""

from typing import Annotated, Literal

import msgspec

from swarmd.mission.fence_config import FenceConfig
from swarmware.errors import InvalidInput
from swarmware.mission.reaction import ReactionRow, misnamed

Seconds = Annotated[float, msgspec.Meta(gt=0, le=600)]


REACTIONS = (
    ReactionRow(
        name="battery_low",
        when="health/state.battery == 'low' or health/state.battery == 'critical'",
        action="return",
        possible="vehicle/way_home.needed_ratio < vehicle/way_home.remaining_ratio",
        otherwise="land",
        says="battery low",
    ),
    ReactionRow(
        name="battery_critical",
        when="health/state.battery == 'critical'",
        action="land",
        lasting=True,
        says="battery critical",
    ),
    ReactionRow(
        name="position_lost",
        when="age(nav/pose) > 1",
        for_s=9.0,  # a motion fails before, after position_patience_s, and its mission decides
        action="land",
        lasting=True,
        says="no valid position",
    ),
    ReactionRow(
        name="loop_late",
        when="health/state.faults['hal/flight/loop=away'] or health/state.faults['hal/flight/loop=starved']",
        action="land",
        says="the flight loop was late",
    ),
    ReactionRow(
        name="tilted",
        when="health/state.faults['hal/flight/tilt=beyond']",
        action="land",
        says="tilt beyond the limit",
    ),
    ReactionRow(
        name="ground_touched",
        when="health/state.faults['hal/flight/contact=touched']",
        where="any",
        action="land",
        says="the ground was touched unexpectedly",
    ),
    ReactionRow(
        name="fence",
        when="nav/fence.leaving",
        where="any",
        action="hold",
        says="leaving the fence",
    ),
    ReactionRow(
        name="mission_restarted",
        when="mission/watch.restarted",
        where="any",
        action="land",
        says="the mission daemon was restarted while the vehicle was armed",
    ),
)
"""Reactions that are shipped; one whose resource does not exist on a vehicle never acts."""


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How missions are dispatched, started together and monitored."""

    start_timeout_s: Seconds = 10.0
    """Time-out of the common start: the mission is withdrawn unless all members are ready within it."""
    lost_after_s: Seconds = 3.0
    """Silence after which a member is lost, if nothing else of its computer is received either."""
    barrier_lead_s: Annotated[float, msgspec.Meta(ge=0.05, le=5)] = 0.25
    """Minimum time from the opening of a barrier to the common time; longer while the beacon rate is low, or
    the computer is late."""
    order_timeout_s: Seconds = 3.0
    """Time for which the ground station waits for a platform's reply to an order."""
    order_expiry_s: Seconds = 10.0
    """Maximum age of an order at its arrival; an older one is refused."""
    navigator_timeout_s: Seconds = 3.0
    """Time without a reply of the navigator after which a motion fails."""
    blocked_patience_s: Seconds = 15.0
    """Time for which the navigator may report `blocked` before the motion fails."""
    position_patience_s: Seconds = 5.0
    """Time without a position after which the motion fails."""
    leader_patience_s: Seconds = 5.0
    """Time without the pose of the formation's leader after which the motion fails."""
    link_loss: Literal["continue", "hold", "return", "land"] = "continue"
    """What a vehicle does when it has lost the link to every ground station; `on_link_loss` of a mission
    precedes it."""
    link_loss_s: Annotated[float, msgspec.Meta(ge=1, le=86_400)] = 30.0
    """Time without a ground station after which the link is lost."""
    home_reserve_ratio: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.1
    """Charge that is to be left after the way home and the landing."""
    emergency_descent_m_s: Annotated[float, msgspec.Meta(gt=0, le=10)] = 1.0
    """Descent rate of an emergency landing above a measured height of 2 m; otherwise the vehicle descends at
    touch-down speed."""
    kept_runs: Annotated[int, msgspec.Meta(ge=1, le=100_000)] = 200
    """Number of runs whose folders are kept, the newest; a limit keeps them from filling the disk."""
    reaction: tuple[ReactionRow, ...] = REACTIONS
    """Reactions to faults; the row `link_loss` is made of the two settings above."""
    fence: FenceConfig | None = None
    """Area and heights that the vehicle must not leave, or None without a fence."""

    def __post_init__(self) -> None:
        """Check the names of the rows."""
        for _, message in misnamed(self.reaction):
            raise InvalidInput(f"reaction: {message}")
