"""Readiness of a vehicle to be armed: a table of items, which may not apply, may pass or may refuse."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import msgspec

from swarmd.health.core.rules import AgeRule, LimitRule
from swarmware.types.fence import FenceState
from swarmware.types.health import OK_STATE, Fault, NotReady, Readiness

POSE_S: Final = 1.5
"""Age above which the pose counts as missing; a vehicle at rest publishes it five times a second."""
FENCE_S: Final = 3.0
"""Age above which the state of the fence is not known; it is published once a second."""
REPEAT_NS: Final = 1_000_000_000
"""Period of `health/ready` without a change, which shows its readers that the monitor runs."""
NAMED: Final = 4
"""Maximum number of faults that a reason names."""
GNSS: Final = "sensor/gnss"
BATTERY: Final = "power/battery"


class ReadinessInputs(msgspec.Struct, frozen=True, kw_only=True):
    """Inputs of readiness that the shell reads in addition to the monitor's own data."""

    estimates: bool
    """True if a service of this node estimates the pose."""
    pose_age_s: float | None = None
    """Age of `nav/pose`, or None without a value."""
    station: bool | None = None
    """True if a ground station is in reach, or None before the first station was."""
    fence: FenceState | None = None
    """Newest value of `nav/fence`, or None without a value."""
    fence_age_s: float = 0.0
    remote_linked: bool | None = None
    """True if the safety pilot's transmitter is received, or None without a receiver."""


class Picture(msgspec.Struct, frozen=True):
    """State of everything that the items check, at one instant."""

    now_ns: int
    around: ReadinessInputs
    ages: Mapping[str, AgeRule]
    """Rules of ages by path, for the resources that applications of this node provide."""
    limits: Sequence[LimitRule]
    faults: Sequence[Fault]
    """Confirmed faults, the worst first."""


Item = Callable[[Picture], str | None]
"""Function that returns why the vehicle is not ready, "" if it is, or None if the item does not apply."""


def estimator(picture: Picture) -> str | None:
    """Item: the pose is estimated, and recent."""
    around = picture.around
    if around.pose_age_s is None:
        return "no pose (nav/pose) yet" if around.estimates else None
    if around.pose_age_s > POSE_S:
        return f"no pose (nav/pose) for {around.pose_age_s:.1f} s"
    return ""


def fix(picture: Picture) -> str | None:
    """Item: satellite navigation has a position of sufficient accuracy."""
    return _measured(picture, GNSS)


def battery(picture: Picture) -> str | None:
    """Item: the charge of the battery is above its warning."""
    return _measured(picture, BATTERY)


def _measured(picture: Picture, path: str) -> str | None:
    """Item for a resource: it is provided, fresh, and within the warnings of its limits."""
    age = picture.ages.get(path)
    if age is None:
        return None
    # judged here and not by the rule, whose confirmation and grace time are too slow for arming
    age_s = age.age_s(picture.now_ns)
    if age_s == float("inf"):
        return f"no value of {path} yet"
    if age_s > max(age.stale_s, POSE_S):
        return f"no value of {path} for {age_s:.1f} s"
    reasons = [
        f"{limit.field} {limit.value:g} ({limit.check}: {state})"
        for limit in picture.limits
        if limit.path == path and limit.value is not None and (state := _bad(limit)) != OK_STATE
    ]
    return ", ".join(reasons)


def _bad(limit: LimitRule) -> str:
    """The present state, or the confirmed state while the present sample passes."""
    return limit.present if limit.present != OK_STATE else limit.state


def link(picture: Picture) -> str | None:
    """Item: a ground station is in reach; applies once a station was in reach."""
    station = picture.around.station
    if station is None:
        return None
    return "" if station else "no ground station in reach (mission/watch)"


def remote(picture: Picture) -> str | None:
    """Item: the safety pilot's transmitter is received; applies to a vehicle with a receiver."""
    linked = picture.around.remote_linked
    if linked is None:
        return None
    return "" if linked else "the safety pilot's transmitter is not received (vehicle/remote)"


def realtime(picture: Picture) -> str | None:
    """Item: the services and motor loops that are to have real-time scheduling have it."""
    found = [fault for fault in picture.faults if _is_scheduling(fault)]
    return ", ".join(f"{fault.check}={fault.state}" for fault in found) or None


def _is_scheduling(fault: Fault) -> bool:
    return fault.level == "warn" and fault.check.endswith(("/realtime", "/flight/scheduling"))


def fence(picture: Picture) -> str | None:
    """Item: the vehicle is inside its geofence; applies to a vehicle with a geofence."""
    state, age_s = picture.around.fence, picture.around.fence_age_s
    if state is None or not state.exists:
        return None
    if age_s > FENCE_S:
        return f"no state of the fence (nav/fence) for {age_s:.0f} s"
    # without a position it is not known, which refuses the arming with the reason of the fence
    if state.inside is None:
        return state.note
    distance_m = state.distance_m or 0.0
    if not state.inside:
        return f"{-distance_m:.1f} m outside ({state.limit})"
    return f"{distance_m:.1f} m from its limit ({state.limit})" if state.leaving else ""


def faults(picture: Picture) -> str | None:
    """Item: no confirmed fault is an error, apart from the faults of the other items."""
    # these faults have items with better reasons
    others = {f"age/{path}" for path in ("nav/pose", GNSS, BATTERY)}
    others |= {limit.check for limit in picture.limits if limit.path in {GNSS, BATTERY}}
    errors = [
        f"{fault.check}={fault.state}"
        for fault in picture.faults
        if fault.level == "error" and fault.check not in others
    ]
    more = f" and {len(errors) - NAMED} more" if len(errors) > NAMED else ""
    return ", ".join(errors[:NAMED]) + more


ITEMS: Final[Mapping[str, Item]] = {
    "estimator": estimator,
    "fix": fix,
    "battery": battery,
    "link": link,
    "remote": remote,
    "fence": fence,
    "faults": faults,
}
"""Items that refuse arming, in the order of display."""


WARNINGS: Final[Mapping[str, Item]] = {"realtime": realtime}
"""Items that warn an operator before arming, without refusing it."""


def assess(picture: Picture) -> Readiness:
    """Computes the readiness from all items that apply."""
    found = {name: reason for name, item in ITEMS.items() if (reason := item(picture)) is not None}
    not_ready = tuple(NotReady(name, reason) for name, reason in found.items() if reason)
    warned = tuple(NotReady(name, reason) for name, item in WARNINGS.items() if (reason := item(picture)))
    return Readiness(not not_ready, not_ready, tuple(found), warned)


class ReadinessRepeater:
    """Decides when a readiness is published: at each change of an item, else once per period."""

    def __init__(self) -> None:
        self._published: Readiness | None = None
        self._due_ns = 0

    def due(self, found: Readiness, now_ns: int) -> bool:
        """True if the readiness is to be published now; a changed number in a reason is not a change."""
        before = self._published
        same = before is not None and _named(before) == _named(found)
        if same and now_ns < self._due_ns:
            return False
        # a tenth early, so that jitter of the calls, which come at this period, does not double the pause
        self._published, self._due_ns = found, now_ns + REPEAT_NS - REPEAT_NS // 10
        return True


def _named(found: Readiness) -> list[str]:
    return [one.item for one in (*found.not_ready, *found.warnings)]
