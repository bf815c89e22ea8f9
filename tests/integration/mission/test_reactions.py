"""Reactions of the mission daemon over real nodes: orders that they end and refuse, rows of a mission."""

from pathlib import Path
from typing import Literal

import msgspec
import pytest
from tests.integration.mission.swarm import FAST, TASK, hover, on_uvloop, swarm

from swarmware.errors import Conflict
from swarmware.mission.reaction import ReactionRow
from swarmware.model.names import hardware_id
from swarmware.module.module import Module
from swarmware.types.health import HealthState
from swarmware.types.mission import (
    AbortAnswer,
    ManoeuvreRequest,
    MissionAbort,
    MissionFile,
    MissionQueue,
    MissionStatus,
    MissionTask,
    TaskAnswer,
)
from swarmware.types.net import Routes, RouteState
from swarmware.types.reaction import MissionWatch, ReactionPhase, Reactions
from swarmware.types.rpc import Empty

CRITICAL = HealthState("error", "critical", 0.1)
LOW = HealthState("warn", "low", 0.25)


def manifest(*rows: str) -> MissionFile:
    role = '[[roles]]\nname = "all"\nfile = "hover.json"\nkinds = ["uav"]\n'
    return MissionFile(
        "mission.toml", 'name = "hover"\n' + role + "".join(f"[[reaction]]\n{r}\n" for r in rows)
    )


@on_uvloop
async def test_lasting_reaction_ends_mission_and_refuses_weaker_orders(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1") as s:
        member = s["uav1"]
        member.vehicle.landed = False
        member.vehicle.answers["land"] = "moving"
        await s.ask(TASK, MissionTask("hover", files=(hover(60.0),)), TaskAnswer)
        await s.until(lambda: "a" in member.passed)
        member.vehicle.health.write(CRITICAL)
        await s.until(lambda: member.history[-1] == "recovering")
        found = await s.ask("sys/mission/status", Empty(), MissionStatus)
        active = {one.row: one.action for one in found.reactions if one.phase is ReactionPhase.ACTIVE}
        # without a charge and a pose over time the way home is not known
        assert active == {"battery_low": "land", "battery_critical": "land"}
        assert (found.state.mission, member.kinds) == ("land", ["land"])
        with pytest.raises(
            Conflict, match=r"goto: reaction battery_critical is active \(land: battery critical"
        ):
            away = ManoeuvreRequest("goto", {"x_m": 1.0, "y_m": 1.0}, "test")
            await s.ask("sys/mission/manoeuvre", away, MissionStatus)
        refused = await s.ask(TASK, MissionTask("hover", files=(hover(1.0),)), TaskAnswer)
        assert "reaction battery_critical is active" in refused.orders[0].reasons[0]
        await s.ask("sys/mission/abort", MissionAbort("test", "hold"), AbortAnswer)
        member.vehicle.health.write(HealthState("ok"))
        reactions = s.operator.reader("mission/reactions", Reactions)
        while any(one.phase is not ReactionPhase.IDLE for one in (reactions.value or Reactions()).rows):
            await reactions.changed()
        assert member.kinds == ["land"], "the abort was refused, and a landing is not ended when it heals"
        await s.ask("sys/mission/abort", MissionAbort("test", "hold"), AbortAnswer)
        await s.until(lambda: "hold" in member.kinds)


@on_uvloop
async def test_rows_of_mission_precede_those_of_platform(tmp_path: Path) -> None:
    low = "health/state.battery == 'low'"
    own = f'name = "battery_low"\nwhen = "{low}"\naction = "hold"\nsays = "its own row"'
    async with swarm(tmp_path, "uav1") as s:
        member = s["uav1"]
        member.vehicle.landed = False
        files = (manifest(own), hover(60.0))
        answer = await s.ask(TASK, MissionTask("hover", files=files), TaskAnswer)
        assert answer.accepted
        await s.until(lambda: "a" in member.passed)
        member.vehicle.health.write(LOW)
        await s.until(lambda: member.history[-1] == "aborted")
        found = await s.ask("sys/mission/status", Empty(), MissionStatus)
        assert (member.kinds, found.state.text) == (["hold"], "its own row")


@on_uvloop
async def test_row_with_unknown_field_is_named_others_act(tmp_path: Path) -> None:
    wrong = msgspec.convert(
        {"name": "wrong", "when": "power/battery.remaining < 2", "action": "hold"}, ReactionRow
    )
    config = msgspec.structs.replace(FAST, reaction=(wrong, *FAST.reaction))
    async with swarm(tmp_path, "uav1", config=config) as s:
        reactions = s.operator.reader("mission/reactions", Reactions)
        while not any(one.note for one in (reactions.value or Reactions()).rows):
            await reactions.changed()
        assert reactions.value is not None
        notes = {one.row: one.note for one in reactions.value.rows if one.note}
        assert list(notes) == ["wrong"]
        assert "BatteryState has no field 'remaining'; did you mean 'remaining_ratio'?" in notes["wrong"]


@pytest.mark.parametrize(("policy", "kinds"), [("land", ["land"]), ("hold", ["hold"])])
@on_uvloop
async def test_lost_link_is_row_with_settings_in_force(
    tmp_path: Path, policy: Literal["land", "hold"], kinds: list[str]
) -> None:
    config = msgspec.structs.replace(FAST, link_loss=policy, link_loss_s=1.0)
    station = RouteState("gcs", hardware_id("gcs"), "gcs", 256, 1, 0, 0)
    async with swarm(tmp_path, "gcs", "uav1", config=config) as s, Module("net", node=s["uav1"].node) as net:
        member = s["uav1"]
        member.vehicle.landed = False
        routes = net.writer("net/routes", Routes)
        watched = net.reader("mission/watch", MissionWatch)
        await s.ask(TASK, MissionTask("hover", files=(hover(60.0),)), TaskAnswer)
        await s.until(lambda: "a" in member.passed)
        routes.write(Routes((station,)))
        while watched.value is None or watched.value.station is not True:
            await watched.changed()
        routes.write(Routes())
        await s.until(lambda: member.history[-1] == "aborted")
        assert member.kinds == kinds
        found = await s.ask("/uav1/sys/mission/status", Empty(), MissionStatus)
        assert found.state.text.startswith("no ground station in reach for ")
        assert watched.value == MissionWatch(station=False)


@on_uvloop
async def test_mission_continues_after_suspending_reaction(tmp_path: Path) -> None:
    low = "health/state.battery == 'low'"
    gust = f'name = "battery_low"\nwhen = "{low}"\naction = "hold"\nresume = true\nsays = "gust"'
    async with swarm(tmp_path, "uav1") as s:
        member = s["uav1"]
        member.vehicle.landed = False
        task = MissionTask("hover", files=(manifest(gust), hover(60.0)))
        assert (await s.ask(TASK, task, TaskAnswer)).accepted
        await s.until(lambda: "a" in member.passed)
        member.vehicle.health.write(LOW)
        await s.until(lambda: "recovering" in member.history)
        queue = await s.ask("sys/mission/queue", Empty(), MissionQueue)
        assert queue.runs[-1].state == "suspended"
        await s.until(lambda: member.history[-1] == "done")
        member.vehicle.health.write(HealthState("ok"))
        await s.until(lambda: member.history.count("running") == 2)
        assert member.history[2:] == [
            "suspending",
            "suspended",
            "recovering",
            "ending",
            "done",
            "running",
        ]
        assert member.kinds == ["hold"]


@on_uvloop
async def test_reaction_starts_stored_mission_first(tmp_path: Path) -> None:
    low = "health/state.battery == 'low'"
    look = f'name = "battery_low"\nwhen = "{low}"\naction = "mission"\nmission = "inspect"\npriority = 7'
    async with swarm(tmp_path, "uav1") as s:
        member = s["uav1"]
        member.vehicle.landed = False
        member.vehicle.answers["takeoff"] = "moving"
        folder = member.node.config.data_path / "missions" / "inspect"
        folder.mkdir(parents=True)
        (folder / "mission.json").write_text(
            '{"requires": ["vehicle/state.armed"], "mission": {"s": {"type": "Start", "next": "g"},'
            ' "g": {"type": "Takeoff", "alt": 5, "next": "e"}, "e": {"type": "End"}}}'
        )
        task = MissionTask("hover", files=(manifest(look), hover(60.0)))
        assert (await s.ask(TASK, task, TaskAnswer)).accepted
        await s.until(lambda: "a" in member.passed)
        member.vehicle.health.write(LOW)
        await s.until(lambda: "takeoff" in member.kinds)
        queue = await s.ask("sys/mission/queue", Empty(), MissionQueue)
        assert [(one.mission, one.priority, one.state) for one in queue.runs] == [
            ("inspect", 7, "running"),
            ("hover", 0, "suspended"),
        ]
        (folder / "mission.json").unlink()
