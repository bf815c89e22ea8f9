"""Settings of the mission daemon (services/mission.toml)."""

from typing import Annotated, Literal

import msgspec

Seconds = Annotated[float, msgspec.Meta(gt=0, le=600)]


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
