"""The mission daemon over real nodes: one instruction, common start, barriers, failures, aborts."""

import asyncio
from pathlib import Path

import msgspec
import pytest
from tests.integration.mission.swarm import FAST, TASK, hover, on_uvloop, swarm
from tests.patience import PATIENCE_S

from swarmware.errors import MissionError, NotFound
from swarmware.types.mission import (
    AbortAnswer,
    ManoeuvreRequest,
    MissionAbort,
    MissionFile,
    MissionList,
    MissionPlan,
    MissionStatus,
    MissionTask,
    TaskAnswer,
)
from swarmware.types.rpc import Empty
from swarmware.types.vehicle import ArmRequest

SILENT_S = 1.0
"""Time without a word of the navigator after which a motion fails, where that is tested."""
FORMATION = MissionTask("formation", params={"speed_m_s": 2.5})


@on_uvloop
async def test_one_instruction_flies_the_formation(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "ugv1", "ugv2", "uav1", "uav2") as s:
        answer = await s.ask(TASK, FORMATION, TaskAnswer)
        assert answer.accepted
        assert {order.platform: order.role for order in answer.orders} == {
            "ugv1": "leader",
            "ugv2": "ground",
            "uav1": "air",
            "uav2": "air",
            "gcs": "control",
        }
        await s.until(lambda: s.all_in("done"))
        assert s["gcs"].history == ["ready", "running", "ending", "done"]
        assert s["uav2"].kinds == ["takeoff", "formation", "formation", "land"]
        assert s["ugv2"].kinds == ["formation", "formation", "land"]
        second = s["uav2"].vehicle.goals[2]
        assert (second.leader, second.advance, second.speed_m_s) == ("ugv1", True, 2.5)
        assert second.offset_m == pytest.approx((-9.0, 3.0, 8.4))
        assert not s["uav2"].vehicle.armed
        # members left each barrier together although their clocks are up to ten seconds apart
        for barrier in ("airborne", "formed", "course", "down"):
            station = () if barrier == "down" else ("gcs",)
            times = [member.passed[barrier] for name, member in s.members.items() if name not in station]
            assert max(times) - min(times) < 100_000_000
        # every order but the station's own is on record, with the receiver's own stamp
        assert sorted(order.platform for order in s.orders) == ["uav1", "uav2", "ugv1", "ugv2"]
        for order in s.orders:
            local = s[order.platform].node.clock.to_mono_ns(order.received_ns)
            sent = s["gcs"].node.clock.to_mono_ns(order.sent_ns)
            acked = s["gcs"].node.clock.to_mono_ns(order.acked_ns)
            assert sent < local < acked
            assert s.arrived[order.platform] == order.received_ns
        # a member's answer leaves before it states what it has taken: the others need that later
        assert s.answered == {name: [] for name in ("uav1", "uav2", "ugv1", "ugv2")}


@on_uvloop
async def test_nobody_starts_when_one_member_refuses(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "ugv1", "uav1", "uav2", uav2=0.1) as s:
        answer = await s.ask(TASK, FORMATION, TaskAnswer)
        assert not answer.accepted
        (refused,) = [order for order in answer.orders if not order.accepted]
        assert refused.platform == "uav2"
        assert "battery > 20 %" in refused.reasons[0]
        await s.until(lambda: s.all_in("idle", "uav2"))
        assert s["uav1"].history == ["ready", "idle"]
        state = (await s.ask("/uav1/sys/mission/status", Empty(), MissionStatus)).state
        assert (state.mission, state.text) == ("", "formation was not started: not accepted by uav2")
        assert s["uav1"].kinds == []
        assert s["uav2"].history == []
        # and the swarm is free for the next one
        again = await s.ask(TASK, MissionTask("formation", members=("gcs", "ugv1", "uav1")), TaskAnswer)
        assert again.accepted
        await s.until(lambda: s.all_in("done", "uav2"))


@on_uvloop
async def test_an_abort_brings_everybody_down(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "ugv1", "uav1") as s:
        s["ugv1"].vehicle.took_s = 30.0
        await s.ask(TASK, FORMATION, TaskAnswer)
        await s.until(lambda: "formation" in s["ugv1"].kinds)
        s["ugv1"].vehicle.took_s = 0.05
        answer = await s.ask("sys/mission/abort", MissionAbort("enough", "hold"), AbortAnswer)
        assert sorted(answer.acknowledged) == ["gcs", "uav1", "ugv1"]
        assert answer.silent == ()
        await s.until(lambda: s["gcs"].history[-1] == "aborted" and s["uav1"].history[-1] == "aborted")
        assert s["uav1"].history == ["ready", "running", "ending", "recovering", "ending", "aborted"]
        assert s["uav1"].kinds[-1] == "hold"
        assert s["uav1"].vehicle.armed


@on_uvloop
async def test_return_lands_where_vehicle_was_armed(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "uav1", "uav2") as s:
        for name in ("uav1", "uav2"):
            s[name].vehicle.landed = False
        s["uav2"].vehicle.answers["goto"] = "blocked:bad_goal"
        await s.ask(TASK, MissionTask("hover", files=(hover(60.0),)), TaskAnswer)
        await s.until(lambda: "a" in s["uav1"].passed)
        await s.ask("sys/mission/abort", MissionAbort("enough", "return"), AbortAnswer)
        await s.until(lambda: s["uav1"].history[-1] == "aborted" and s["uav2"].history[-1] == "failed")
        assert s["uav1"].kinds == ["goto", "land"]
        back = s["uav1"].vehicle.goals[0]
        assert (back.x_m, back.y_m, back.z_m, back.speed_m_s) == (0.0, 0.0, 2.0, 2.0)
        # what keeps it from the way back does not keep it from landing
        assert s["uav2"].kinds == ["goto", "hold", "land"]
        assert not s["uav2"].vehicle.armed
        assert "bad_goal" in (await s.ask("/uav2/sys/mission/status", Empty(), MissionStatus)).state.text


@on_uvloop
async def test_blocked_navigator_makes_all_vehicles_land(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "ugv1", "uav1") as s:
        s["uav1"].vehicle.answers["formation"] = "blocked"
        await s.ask(TASK, FORMATION, TaskAnswer)
        await s.until(lambda: s.all_in("failed"))
        assert [kind for kind in s["uav1"].kinds if kind != "hold"] == ["takeoff", "formation", "land"]
        assert s["ugv1"].kinds[-1] == "land"
        assert not s["ugv1"].vehicle.armed
        status = await s.ask("/uav1/sys/mission/status", Empty(), MissionStatus)
        assert "form ended with error:blocked" in status.state.text
        assert status.others["gcs"].state == "failed"
        # the application of this test, on the node of the ground station
        assert status.ordered_by.endswith("@gcs")
        own = await s.ask("/gcs/sys/mission/status", Empty(), MissionStatus)
        assert own.ordered_by.endswith("gcs")


@on_uvloop
async def test_the_formation_is_completed_without_the_ground_station(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "ugv1", "uav1") as s:
        s["ugv1"].vehicle.took_s = s["uav1"].vehicle.took_s = 0.2
        assert (await s.ask(TASK, FORMATION, TaskAnswer)).accepted
        await s.until(lambda: "formed" in s["uav1"].passed)
        await s.kill("gcs")
        await s.until(lambda: s.all_in("done", "gcs"))
        assert s["uav1"].kinds == ["takeoff", "formation", "formation", "land"]
        assert not s["uav1"].vehicle.armed


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ("blocked:no_way", "error:blocked: no_way"),
        ("blocked:disarmed", "error:disarmed: disarmed"),
        ("holding:leader_lost:ugv1", "error:leader_lost: leader_lost: ugv1"),
        ("holding:no_position", "error:no_position: no_position"),
        ("blocked:bad_goal:it cannot", "error:blocked: bad_goal: it cannot"),
        ("elsewhere", "error:blocked: another goal"),
        ("", "error:no_navigator: no answer to goal"),
    ],
)
@on_uvloop
async def test_navigator_report_decides_how_motion_ends(tmp_path: Path, answer: str, words: str) -> None:
    text = """{"mission": {
        "s": {"type": "Start", "next": "go"},
        "go": {"type": "Goto", "x": 3, "y": 4, "z": 5, "next": "e"},
        "e": {"type": "End"}
    }}"""
    config = msgspec.structs.replace(FAST, navigator_timeout_s=SILENT_S)
    async with swarm(tmp_path, "ugv1", config=config) as s:
        vehicle = s["ugv1"].vehicle
        vehicle.answers["goto"] = answer
        # without a word for longer than the daemon waits
        vehicle.took_s = 0.05 if answer else 1.5 * SILENT_S
        await s.ask(TASK, MissionTask("go", files=(MissionFile("go.json", text),)), TaskAnswer)
        await s.until(lambda: "recovering" in s["ugv1"].history)
        vehicle.took_s = 0.05
        await s.until(lambda: s["ugv1"].history[-1:] == ["failed"])
        status = await s.ask("sys/mission/status", Empty(), MissionStatus)
        assert words in status.state.text
        assert vehicle.goals[0].kind == "goto"


@on_uvloop
async def test_waypoints_are_visited_in_their_order(tmp_path: Path) -> None:
    text = """{"mission": {
        "s": {"type": "Start", "next": "a"},
        "a": {"type": "Arm", "next": "t"},
        "t": {"type": "Takeoff", "alt": 5, "next": "way"},
        "way": {"type": "Waypoints", "points": [[3, 4], [5, 6, 7]], "speed": 2, "loiter": 0.1, "next": "e"},
        "e": {"type": "End"}
    }}"""
    async with swarm(tmp_path, "gcs", "uav1") as s:
        vehicle = s["uav1"].vehicle
        order = MissionTask("way", files=(MissionFile("way.json", text),), members=("uav1",))
        await s.ask(TASK, order, TaskAnswer)
        await s.until(lambda: s["uav1"].history[-1:] == ["done"])
        assert s["uav1"].kinds == ["takeoff", "goto", "goto"]
        first, second = vehicle.goals[1:]
        # a position without a height keeps the present height
        assert (first.x_m, first.y_m, first.z_m, first.speed_m_s) == (3.0, 4.0, 0.0, 2.0)
        assert (second.x_m, second.y_m, second.z_m) == (5.0, 6.0, 7.0)


@on_uvloop
async def test_vehicle_that_does_not_arm_fails_mission(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "ugv1", "uav1") as s:
        s["uav1"].vehicle.refuses_to_arm = True
        await s.ask(TASK, FORMATION, TaskAnswer)
        await s.until(lambda: s.all_in("failed"))
        status = await s.ask("/uav1/sys/mission/status", Empty(), MissionStatus)
        assert "error:refused: safety switch" in status.state.text


@on_uvloop
async def test_forced_take_off_arms_in_operators_name(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1") as s:
        up = ManoeuvreRequest("takeoff", {"altitude_m": 3.0}, "wind is low", force=True)
        await s.ask("sys/mission/manoeuvre", up, MissionStatus)
        await s.until(lambda: s["uav1"].kinds == ["takeoff"])
        forced = ArmRequest(True, True, "takeoff by operator#1@uav1: wind is low")
        assert s["uav1"].vehicle.orders.get_nowait() == forced
        # a second take-off during the first one commands a hold between them
        await s.until(lambda: s["uav1"].history[-1:] == ["done"])
        usual = ManoeuvreRequest("takeoff", {"altitude_m": 3.0}, "again")
        await s.ask("sys/mission/manoeuvre", usual, MissionStatus)
        await s.until(lambda: s["uav1"].kinds == ["takeoff", "takeoff"])
        assert s["uav1"].vehicle.orders.get_nowait() == ArmRequest(True)


@on_uvloop
async def test_arming_that_waits_is_withdrawn_with_its_mission(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1") as s:
        vehicle = s["uav1"].vehicle
        vehicle.ready.clear()
        up = ManoeuvreRequest("takeoff", {"altitude_m": 3.0})
        await s.ask("sys/mission/manoeuvre", up, MissionStatus)
        async with asyncio.timeout(PATIENCE_S):
            assert await vehicle.orders.get() == ArmRequest(True)
            await s.ask("sys/mission/abort", MissionAbort("not now", "hold"), AbortAnswer)
            assert await vehicle.orders.get() == ArmRequest(False, reason="the arming was cancelled")
        vehicle.ready.set()


@on_uvloop
async def test_a_member_that_falls_silent_breaks_the_barrier(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2", "uav3") as s:
        answer = await s.ask(TASK, MissionTask("hover", files=(hover(3.0),)), TaskAnswer)
        assert answer.accepted
        await s.until(lambda: all("a" in member.passed for member in s.members.values()))
        await s.kill("uav3")
        await s.until(lambda: s["uav1"].history[-1] == "failed" and s["uav2"].history[-1] == "failed")
        status = await s.ask("/uav2/sys/mission/status", Empty(), MissionStatus)
        assert "uav3" in status.state.text
        assert s["uav1"].kinds == ["land"]


@on_uvloop
async def test_vehicle_under_way_lands_after_daemon_restart(tmp_path: Path) -> None:
    from swarmd.mission.service import Mission

    async with swarm(tmp_path, "uav1") as s:
        await s.ask(TASK, MissionTask("hover", files=(hover(60.0),)), TaskAnswer)
        await s.until(lambda: s["uav1"].vehicle.armed and "a" in s["uav1"].passed)
        member = s["uav1"]
        await s.kill("uav1")
        for writer in list(member.daemon._writers):
            member.daemon.close_writer(writer)
        member.task = asyncio.create_task(Mission(member.daemon, member.daemon.config).run())
        await s.until(lambda: member.history[-1] == "done")
        assert member.history[-3:] == ["recovering", "ending", "done"]
        assert member.kinds[-1] == "land"
        assert not member.vehicle.armed


@on_uvloop
async def test_second_instruction_waits_for_the_first(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "uav1") as s:
        task = MissionTask("hover", files=(hover(0.5),))
        assert (await s.ask(TASK, task, TaskAnswer)).accepted
        await s.until(lambda: "running" in s["uav1"].history)
        second = await s.ask(TASK, task, TaskAnswer)
        assert second.accepted
        assert second.orders[0].waits.startswith("after hover")
        await s.until(lambda: s["uav1"].history.count("done") == 2)


@pytest.mark.parametrize(
    ("task", "error", "words"),
    [
        (MissionTask("dance"), NotFound, "mission 'dance': not in the store; expected one of: .*formation"),
        (MissionTask("formation", members=("uav9",)), NotFound, "'uav9': not known here"),
        (MissionTask("formation", members=("gcs",)), MissionError, "role 'leader': no ugv"),
        (MissionTask("formation", params={"spede": 1.0}), MissionError, "'spede': unknown in formation"),
        (
            MissionTask("x", files=(MissionFile("x.json", '{"mission": {"b0": {"type": "Strat"}}}'),)),
            MissionError,
            "'Strat': unknown; nearest known: Start",
        ),
    ],
)
@on_uvloop
async def test_an_instruction_that_makes_no_sense_reaches_nobody(
    tmp_path: Path, task: MissionTask, error: type[Exception], words: str
) -> None:
    async with swarm(tmp_path, "gcs", "ugv1") as s:
        with pytest.raises(error, match=words):
            await s.ask(TASK, task, TaskAnswer)
        assert s.orders == []
        assert s["ugv1"].history == []


@on_uvloop
async def test_plan_names_excluded_vehicles_and_orders_nothing(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs", "uav1", "ugv1") as s:
        one = MissionTask("hover", files=(hover(0.1),))
        plan = await s.ask("sys/mission/plan", one, MissionPlan)
        assert [member.platform for member in plan.members] == ["uav1", "ugv1"]
        assert not plan.left_out, "a ground station has nothing to fly"
        await s.kill("ugv1")
        async with asyncio.timeout(PATIENCE_S):
            while len(plan.left_out) < 1:
                plan = await s.ask("sys/mission/plan", one, MissionPlan)
        assert plan.left_out[-1].platform == "ugv1"
        assert "lost: no beacon for" in plan.left_out[-1].why
        named = msgspec.structs.replace(one, members=("uav1",))
        assert (await s.ask("sys/mission/plan", named, MissionPlan)).left_out == ()
        assert s["uav1"].history == []
        answer = await s.ask(TASK, one, TaskAnswer)
        assert [left.platform for left in answer.left_out] == ["ugv1"]


@on_uvloop
async def test_the_store_lists_the_missions_of_the_installation(tmp_path: Path) -> None:
    async with swarm(tmp_path, "gcs") as s:
        found = await s.ask("sys/mission/ls", Empty(), MissionList)
        (formation,) = [mission for mission in found.missions if mission.name == "formation"]
        assert formation.sound
        assert formation.roles == ("leader", "ground", "air", "control")
