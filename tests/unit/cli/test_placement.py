"""Verdicts on the placement of applications, as a table of measurements."""

import msgspec
import pytest

from swarmctl.commands.doctor.placement_verdict import judge
from swarmware.types.driver import LineLoad
from swarmware.types.placement import PlacedApplication, RemoteInput, UnitPlacement

LINK = 100e6


def app(name: str, cpu_percent: float = 1.0, in_process: int = 1) -> PlacedApplication:
    return PlacedApplication(name, cpu_percent, in_process, 0.5, 10)


def pose(
    p95_ms: float | None = 9.0,
    *,
    values: int = 60,
    size: int = 60,
    within_s: float = 0.05,
    worst_ms: float = 9.0,
) -> RemoteInput:
    late_ms = p95_ms and max(p95_ms, worst_ms)
    return RemoteInput(
        "nav/pose",
        "nav",
        ("guidance",),
        within_s,
        values,
        values * size,
        p95_ms and p95_ms / 2,
        p95_ms,
        late_ms,
    )


def unit(
    *inputs: RemoteInput,
    name: str = "fc",
    busy_percent: float = 40.0,
    apps: tuple[PlacedApplication, ...] = (),
) -> UnitPlacement:
    own = apps or (app("broker"), app("tree", 2.0), app("guidance", 5.0), app("hal", 3.0))
    return UnitPlacement("uav1", name, 3.0, 2, busy_percent, own, inputs)


NAV = UnitPlacement("uav1", "nav", 3.0, 2, 30.0, (app("broker"), app("estimator")))


@pytest.mark.parametrize(
    ("fc", "rate_bit_s", "verdict", "reason"),
    [
        (unit(pose()), LINK, "separable", "delays at most 9.0 ms"),
        (unit(pose(51.0)), LINK, "together", "with nav: nav/pose after 51.0 ms, needed within 50.0 ms"),
        (unit(pose(49.0, worst_ms=215.0)), LINK, "separable", "delays at most 215.0 ms"),
        (unit(pose(1017.0, values=3, within_s=0.0)), LINK, "separable", "delays at most 1017.0 ms"),
        (unit(pose(1017.0, values=3, within_s=3.0)), LINK, "separable", "delays at most 1017.0 ms"),
        (
            unit(pose(size=60_000)),
            16e6,
            "together",
            "with nav: 9617 kbit/s, at most 50% of 16000 kbit/s",
        ),
        (unit(pose(size=40_000)), 16e6, "separable", "delays at most 9.0 ms"),
        (unit(pose(size=60_000)), None, "separable", "delays at most 9.0 ms; rate of the link unknown"),
        (unit(pose(size=60)), 25_000.0, "together", "with nav: 27 kbit/s, at most 50% of 25 kbit/s"),
        (unit(pose(None, values=0)), LINK, "separable", "no value arrived in the window"),
        (
            unit(pose(), apps=(app("broker", 30.0), app("tree", 15.0), app("guidance"))),
            LINK,
            "together",
            "with nav: communication takes 22 % of fc, accepted 20%",
        ),
        (unit(pose(), busy_percent=165.0), LINK, "separate", "fc: 82 % of its cores busy; at most 80%"),
        (
            unit(pose(), busy_percent=165.0, apps=(app("guidance", 2.0), app("hal", 3.0))),
            LINK,
            "separable",
            "delays at most 9.0 ms",
        ),
    ],
)
def test_delay_link_overhead_and_capacity_decide(
    fc: UnitPlacement, rate_bit_s: float | None, verdict: str, reason: str
) -> None:
    nav = msgspec.structs.replace(NAV, rates_bit_s={} if rate_bit_s is None else {"fc": rate_bit_s})
    report = judge("uav1", [nav, fc])
    found = {(one.unit, one.application): (one.verdict, one.reason) for one in report.modules}
    assert found["fc", "guidance"] == (verdict, reason)
    assert found["nav", "estimator"] == ("here", "no input of another computer")
    assert ("fc", "broker") not in found, "each computer has it"
    elsewhere = {"together", "separate"}
    assert report.objections is any(one.verdict in elsewhere for one in report.modules)
    assert report.objections or verdict not in elsewhere


def test_stated_rate_takes_place_of_reported_one() -> None:
    nav = msgspec.structs.replace(NAV, rates_bit_s={"fc": 25_000.0})
    assert judge("uav1", [nav, unit(pose())]).objections
    assert not judge("uav1", [nav, unit(pose())], 1e6).objections


def test_heaviest_module_leaves_overloaded_computer() -> None:
    report = judge("ugv1", [unit(busy_percent=190.0)], LINK)
    assert [(one.application, one.verdict) for one in report.modules] == [
        ("guidance", "separate"),
        ("hal", "here"),
    ]
    (load,) = report.units
    assert (load.busy_percent, load.free_percent, load.over_capacity) == (95.0, 5.0, True)
    assert load.interfaces == 40
    alone = judge("ugv1", [unit(busy_percent=190.0, apps=(app("broker"), app("hal")))], LINK)
    assert [one.verdict for one in alone.modules] == ["here"], "it is alone: another place gains nothing"


def test_overhead_is_known_with_separate_communication_processes() -> None:
    (apart,) = judge("uav1", [unit()], LINK).units
    assert apart.communication_percent == 1.5
    (shared,) = judge("uav1", [unit(apps=(app("broker", 9.0, 12), app("tree", 9.0, 12)))], LINK).units
    assert shared.communication_percent is None


def test_bytes_between_computers_have_headers() -> None:
    report = judge("uav1", [NAV, unit(pose(), pose())], LINK, ["main"])
    (link,) = report.links
    assert (link.sender, link.receiver) == ("nav", "fc")
    assert link.bytes_s == pytest.approx(2 * 20 * (60 + 108))
    assert report.silent == ["main"]


def test_a_line_over_its_capacity_is_an_objection() -> None:
    full = LineLoad("/dev/i2c-1", ("bmp280", "invensense"), 153_000.0, 100_000.0)
    nearly = LineLoad("/dev/ttyS0", ("nmea",), 79_000.0, 100_000.0)
    unknown = LineLoad("can0", ("vesc",), 79_000.0, 0.0)
    report = judge("uav1", [NAV], LINK, lines=[full, nearly, unknown])
    assert [line.over_capacity for line in report.lines] == [True, False, False]
    assert report.objections
    assert not judge("uav1", [NAV], LINK, lines=[nearly]).objections
