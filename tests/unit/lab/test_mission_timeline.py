"""The course of a mission from its log: spans of blocks, lanes, barriers."""

import pytest

from swarmlab.measure import mission_timeline
from swarmlab.measure.clocks import ClockTruth
from swarmlab.measure.mission_timeline import BarrierPassage
from swarmware.types.mission import BarrierResult, MissionPhase, MissionProgress, MissionState


def step(t_s: float, block: str, event: str, text: str = "") -> tuple[float, MissionProgress]:
    kind = block.capitalize() if block else "Mission"
    return t_s, MissionProgress("formation", 7, block, kind, event, 0, text)


def test_blocks_become_spans_in_separate_lanes() -> None:
    member = mission_timeline.of_member(
        "uav1",
        [
            step(-9.0, "old", "started"),
            step(0.1, "", "state:ready"),
            step(2.0, "", "state:running"),
            step(2.0, "arm", "started"),
            step(3.0, "arm", "ok"),
            step(3.0, "form", "started"),
            step(4.0, "photo", "started"),
            step(6.0, "photo", "error:camera", "no picture"),
            step(7.0, "arm", "started"),
            step(8.0, "", "state:recovering"),
            step(9.0, "", "state:failed"),
        ],
        10.0,
    )
    assert [(s.block, s.start_s, s.end_s, s.outcome, s.lane) for s in member.spans] == [
        ("@ready", 0.1, 2.0, "", 0),
        ("arm", 2.0, 3.0, "ok", 0),
        ("form", 3.0, 10.0, "", 0),
        ("photo", 4.0, 6.0, "error:camera", 1),
        ("arm", 7.0, 10.0, "", 1),
        ("@recovery", 8.0, 9.0, "", 2),
    ]
    assert (member.outcome, member.end_s, member.lanes) == (MissionPhase.FAILED, 9.0, 3)
    assert mission_timeline.of_member("uav2", [], 10.0).lanes == 1


def test_barrier_opens_at_instant_or_is_named_broken() -> None:
    clocks = {"uav1": ClockTruth(5.0, 0.0), "uav2": ClockTruth(-3.0, 0.0)}
    origin_ns = 10**12

    def state(platform: str, *results: tuple[str, int, float | None]) -> MissionState:
        clock = clocks[platform].clock
        meetings = tuple(
            BarrierResult(
                name, visit, None if at_s is None else clock.from_mono_ns(origin_ns + round(at_s * 1e9))
            )
            for name, visit, at_s in results
        )
        return MissionState(7, "", MissionPhase.RUNNING, meetings=meetings)

    found = mission_timeline.passages(
        {
            "uav1": [
                (1.0, state("uav1", ("go", 1, 1.5))),
                (9.0, state("uav1", ("go", 2, 8.0), ("end", 1, None))),
            ],
            "uav2": [(1.1, state("uav2", ("go", 1, 1.502)))],
        },
        clocks,
        origin_ns,
    )
    assert [(p.barrier, p.visit, p.members, p.broken) for p in found] == [
        ("go", 1, 2, False),
        ("go", 2, 1, False),
        ("end", 1, 1, True),
    ]
    assert found[0].at_s == pytest.approx(1.501)
    assert found[0].spread_s == pytest.approx(0.002, abs=1e-6)
    assert found[2] == BarrierPassage("end", 1, 9.0, 0.0, 1, broken=True)
