"""The queue through the daemons: orders wait, a higher priority suspends, runs are cancelled and moved."""

from pathlib import Path

from tests.integration.mission.swarm import TASK, hover, on_uvloop, swarm

from swarmware.types.mission import (
    AbortAnswer,
    MissionAbort,
    MissionFile,
    MissionQueue,
    MissionTask,
    PriorityChange,
    TaskAnswer,
)
from swarmware.types.rpc import Empty

GOTO = MissionFile(
    "away.json",
    """{"priority": 5, "mission": {
        "s": {"type": "Start", "next": "arm"},
        "arm": {"type": "Arm", "next": "g"},
        "g": {"type": "Goto", "x": 5, "y": 0, "next": "e"},
        "e": {"type": "End"}
    }}""",
)


@on_uvloop
async def test_orders_wait_and_are_cancelled_and_moved(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "ugv1", "ugv2") as s:
        first = await s.ask(TASK, MissionTask("hover", files=(hover(60.0),)), TaskAnswer)
        await s.until(lambda: "a" in s["ugv1"].passed and "a" in s["ugv2"].passed)
        ids = []
        for name in ("second", "third"):
            answer = await s.ask(
                TASK, MissionTask(name, files=(hover(0.1),), members=("ugv1", "ugv2")), TaskAnswer
            )
            assert answer.accepted
            assert answer.orders[0].waits == f"after hover ({first.epoch}), priority 0"
            ids.append(answer.epoch)
        await s.ask("sys/mission/prioritize", PriorityChange(ids[1], 0), AbortAnswer)
        await s.until(lambda: "priority" in s["ugv1"].history)
        queue = await s.ask("/ugv1/sys/mission/queue", Empty(), MissionQueue)
        assert [(one.mission, one.state) for one in queue.runs] == [
            ("hover", "running"),
            ("hover", "waiting"),
            ("hover", "waiting"),
        ]
        assert [one.epoch for one in queue.runs] == [first.epoch, *ids]
        cancelled = await s.ask("sys/mission/abort", MissionAbort("not needed", "", ids[0]), AbortAnswer)
        assert sorted(cancelled.acknowledged) == ["ugv1", "ugv2"]
        await s.until(lambda: "idle" in s["ugv1"].history)
        s["ugv1"].history.clear()
        await s.ask("sys/mission/abort", MissionAbort("enough", "", first.epoch), AbortAnswer)
        await s.until(lambda: s["ugv1"].history[-1:] == ["done"] and s["ugv2"].history[-1:] == ["done"])
        assert s["ugv1"].history == [
            "ending",
            "recovering",
            "ending",
            "aborted",
            "ready",
            "running",
            "ending",
            "done",
        ]


@on_uvloop
async def test_higher_priority_suspends_one_member_of_mission(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "ugv1", "ugv2") as s:
        s["ugv2"].vehicle.answers["goto"] = "moving"
        both = MissionTask("hover", files=(hover(0.2),), members=("ugv1", "ugv2"))
        await s.ask(TASK, both, TaskAnswer)
        await s.until(lambda: "a" in s["ugv2"].passed)
        answer = await s.ask(TASK, MissionTask("", files=(GOTO,), members=("ugv2",)), TaskAnswer)
        await s.until(lambda: "goto" in s["ugv2"].kinds)
        queue = await s.ask("/ugv2/sys/mission/queue", Empty(), MissionQueue)
        assert [(one.priority, one.state) for one in queue.runs] == [(5, "running"), (0, "suspended")]
        assert queue.runs[1].why == f"away ({answer.epoch}) of priority 5 comes first"
        assert "b" not in s["ugv1"].passed
        # the rescue is cancelled: its vehicle lands, as its on_failure says, and takes its part up again
        await s.ask("sys/mission/abort", MissionAbort("enough", "", answer.epoch), AbortAnswer)
        await s.until(lambda: s.all_in("done", "gcs"))
        assert "b" in s["ugv1"].passed and "b" in s["ugv2"].passed
        assert "preempts" in s["ugv2"].history
