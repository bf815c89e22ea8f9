"""Settings of the mission daemon (services/mission.toml)."""

from typing import Annotated

import msgspec

Seconds = Annotated[float, msgspec.Meta(gt=0, le=600)]


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How missions are handed out, started together and watched."""

    start_timeout_s: Seconds = 10.0
    """Until all members stand ready; afterwards nobody starts."""
    lost_after_s: Seconds = 3.0
    """Silence after which a member is lost, if nothing else is heard of its computer either."""
    barrier_lead_s: Annotated[float, msgspec.Meta(ge=0.05, le=5)] = 0.25
    """Least time from the opening of a barrier to the common time; longer while the links' rate is low."""
    order_timeout_s: Seconds = 3.0
    """How long the ground station waits for a platform's answer to an order."""
    order_expiry_s: Seconds = 10.0
    """An order that is older when it arrives is refused."""
    navigator_timeout_s: Seconds = 3.0
    """Without an answer of the navigator for this long a motion fails."""
    blocked_patience_s: Seconds = 15.0
    """A navigator may say for this long that it is blocked before the motion fails."""
    position_patience_s: Seconds = 5.0
    """A navigator may be without its position for this long before the motion fails."""
    leader_patience_s: Seconds = 5.0
    """A formation's leader may be unheard of for this long before the motion fails."""
