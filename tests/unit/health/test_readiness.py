"""Readiness: the items that are not ready, from the data of the monitor and further inputs."""

from typing import Any

import pytest

from swarmd.health.config import LIMITS, LimitConfig
from swarmd.health.core.readiness import (
    ITEMS,
    Picture,
    ReadinessInputs,
    ReadinessRepeater,
    assess,
)
from swarmd.health.core.rules import AgeRule, LimitRule
from swarmware.model.resource import Resource
from swarmware.types.fence import FenceLimit, FenceState
from swarmware.types.health import Fault, Level, NotReady, Phase, Readiness

SECOND = 1_000_000_000
NOW = 100 * SECOND
GRACE = NOW + 10 * SECOND
"""The monitor is young: its own rules raise no fault yet."""
FIX = Resource(path="sensor/gnss", type="GnssFix", rate_hz=10, max_age_s=0.6)
CHARGE = Resource(path="power/battery", type="BatteryState", rate_hz=1)


def age(resource: Resource, old_s: float | None) -> AgeRule:
    rule = AgeRule(resource, GRACE)
    if old_s is not None:
        rule.on_sample(1, NOW - round(old_s * 1e9))
    return rule


def limit(check: str, *values: float, grace_until_ns: int = GRACE) -> LimitRule:
    config: LimitConfig = next(one for one in LIMITS if one.check == check)
    rule = LimitRule(check, config.path, config.field, config.criterion(), config.confirm, grace_until_ns)
    for value in values:
        rule.on_value(value, NOW)
    return rule


def fault(check: str, level: Any = "error", state: str = "died") -> Fault:
    return Fault(check, state, level, Phase.CONFIRMED, 1, 1, 1)


def picture(
    *ages: AgeRule,
    limits: tuple[LimitRule, ...] = (),
    faults: tuple[Fault, ...] = (),
    **around: Any,
) -> Picture:
    return Picture(
        NOW,
        ReadinessInputs(**{"estimates": False} | around),
        {rule.path: rule for rule in ages},
        limits,
        faults,
    )


FRESH_FIX = age(FIX, 0.1)
FRESH_CHARGE = age(CHARGE, 1.0)


@pytest.mark.parametrize(
    ("item", "seen", "reason"),
    [
        ("estimator", picture(), None),
        ("estimator", picture(estimates=True), "no pose (nav/pose) yet"),
        ("estimator", picture(estimates=True, pose_age_s=0.2), ""),
        ("estimator", picture(pose_age_s=0.2), ""),
        ("estimator", picture(estimates=True, pose_age_s=4.0), "no pose (nav/pose) for 4.0 s"),
        ("fix", picture(FRESH_CHARGE), None),
        ("fix", picture(FRESH_FIX), ""),
        ("fix", picture(age(FIX, None)), "no value of sensor/gnss yet"),
        ("fix", picture(age(FIX, 7.0)), "no value of sensor/gnss for 7.0 s"),
        ("fix", picture(FRESH_FIX, limits=(limit("gnss/accuracy", 2.0),)), ""),
        (
            "fix",
            picture(FRESH_FIX, limits=(limit("gnss/accuracy", 9.0), limit("gnss/satellites", 3))),
            "h_acc_m 9 (gnss/accuracy: warn), satellites 3 (gnss/satellites: error)",
        ),
        ("battery", picture(FRESH_FIX), None),
        ("battery", picture(FRESH_CHARGE, limits=(limit("battery/charge", 0.9),)), ""),
        (
            "battery",
            picture(FRESH_CHARGE, limits=(limit("battery/charge", 0.12),)),
            "remaining_ratio 0.12 (battery/charge: error)",
        ),
        (
            "battery",  # the newest sample passes, three of the last five did not
            picture(FRESH_CHARGE, limits=(limit("battery/charge", 0.2, 0.2, 0.2, 0.9, grace_until_ns=0),)),
            "remaining_ratio 0.9 (battery/charge: warn)",
        ),
        ("battery", picture(age(CHARGE, 4.0)), "no value of power/battery for 4.0 s"),
        ("battery", picture(age(CHARGE, 2.5)), ""),
        ("link", picture(), None),
        ("link", picture(station=True), ""),
        ("link", picture(station=False), "no ground station in reach (mission/watch)"),
        ("remote", picture(), None),
        ("remote", picture(remote_linked=True), ""),
        (
            "remote",
            picture(remote_linked=False),
            "the safety pilot's transmitter is not received (vehicle/remote)",
        ),
        ("fence", picture(), None),
        ("fence", picture(fence=FenceState(False)), None),
        ("fence", picture(fence=FenceState(True, True, False, 3.0, FenceLimit.AREA)), ""),
        (
            "fence",
            picture(fence=FenceState(True, False, True, -3.25, FenceLimit.AREA)),
            "3.2 m outside (area)",
        ),
        (
            "fence",
            picture(fence=FenceState(True, True, True, 1.0, FenceLimit.MAX_HEIGHT)),
            "1.0 m from its limit (max_height)",
        ),
        ("fence", picture(fence=FenceState(True, note="no pose (nav/pose)")), "no pose (nav/pose)"),
        (
            "fence",
            picture(fence=FenceState(True, True, False, 3.0), fence_age_s=9.0),
            "no state of the fence (nav/fence) for 9 s",
        ),
        ("faults", picture(), ""),
        ("faults", picture(faults=(fault("app/sim", "warn"),)), ""),
        (
            "faults",
            picture(faults=(fault("app/sim"), fault("driver/imu", state="failed"))),
            "app/sim=died, driver/imu=failed",
        ),
        (
            "faults",
            picture(faults=tuple(fault(f"app/a{i}") for i in range(6))),
            "app/a0=died, app/a1=died, app/a2=died, app/a3=died and 2 more",
        ),
        (
            "faults",  # another item names these
            picture(
                FRESH_CHARGE,
                limits=(limit("battery/charge", 0.1),),
                faults=(fault("battery/charge"), fault("age/nav/pose"), fault("age/power/battery")),
            ),
            "",
        ),
    ],
)
def test_item_applies_and_refuses_by_what_is_there(item: str, seen: Picture, reason: str | None) -> None:
    assert ITEMS[item](seen) == reason


def test_vehicle_is_ready_with_all_applicable_items() -> None:
    assert assess(picture()) == Readiness(True, (), ("faults",))
    seen = picture(FRESH_CHARGE, limits=(limit("battery/charge", 0.1),), estimates=True, station=True)
    found = assess(seen)
    assert found.items == ("estimator", "battery", "link", "faults")
    assert found.not_ready == (
        NotReady("estimator", "no pose (nav/pose) yet"),
        NotReady("battery", "remaining_ratio 0.1 (battery/charge: error)"),
    )
    assert not found.ready
    assert found.reasons == (
        "estimator: no pose (nav/pose) yet; battery: remaining_ratio 0.1 (battery/charge: error)"
    )


@pytest.mark.parametrize(
    ("check", "level", "warned"),
    [
        ("hal/realtime", "warn", True),
        ("hal/flight/scheduling", "warn", True),
        ("hal/flight/loop", "warn", False),
        ("hal/realtime", "error", False),
    ],
)
def test_loop_without_real_time_warns_unless_required(check: str, level: Level, warned: bool) -> None:
    found = assess(picture(faults=(fault(check, level),)))
    assert found.warnings == ((NotReady("realtime", f"{check}=died"),) if warned else ())
    assert found.ready is (level == "warn")


def test_a_new_warning_is_published_at_once() -> None:
    repeater = ReadinessRepeater()
    assert repeater.due(assess(picture()), NOW)
    assert not repeater.due(assess(picture()), NOW + 1)
    assert repeater.due(assess(picture(faults=(fault("hal/realtime", "warn"),))), NOW + 2)


def test_change_is_published_at_once_then_repeated() -> None:
    repeater = ReadinessRepeater()
    good, bad = Readiness(True), Readiness(False, (NotReady("link", "for 4 s"),))
    longer = Readiness(False, (NotReady("link", "for 5 s"),))
    steps = [(0.0, good), (0.5, good), (1.0, good), (1.5, bad), (2.0, longer), (2.5, longer), (3.0, good)]
    due = [repeater.due(found, NOW + round(at_s * 1e9)) for at_s, found in steps]
    assert due == [True, False, True, True, False, True, True]
