"""`swarmctl doctor` shows what the running node has found itself."""

import asyncio
import os
from pathlib import Path

import pytest

from swarmctl.commands.doctor.check_result import CheckResult
from swarmctl.commands.doctor.checks import examine
from swarmware.model.acl import FILE
from swarmware.module.module import Module
from swarmware.service.effective import effective_config
from swarmware.testing.tmpnode import make_node
from swarmware.types.health import Fault, FaultList, FaultQuery, Phase
from swarmware.types.net import Denial, RosterMemberState, RosterState, Routes, RouteState
from swarmware.types.rpc import Empty


async def examined(config_dir: Path, *checks: str) -> list[CheckResult]:
    results = await asyncio.to_thread(examine, {"uav1": config_dir}, fix=False)
    return [result for result in results if result.check in checks]


async def test_refused_senders_are_listed_with_address_and_count(tmp_path: Path) -> None:
    config_dir = make_node(tmp_path)
    async with Module("broker", config_dir=config_dir) as broker:
        denials = broker.stream_writer("net/denials", Denial, kind="event")
        assert await examined(config_dir, "denied") == []
        for count in (1, 3):
            denials.write(Denial("uav2", "node", "call", "cmd/goto", count, "expected role operator"))
        denials.write(Denial("uav3", "observer", "call", "sys/tree/set", 1, "expected role operator"))
        first, second = await examined(config_dir, "denied")
    assert first.verdict == second.verdict == "warning"
    assert first.text.startswith("node@uav2: cmd/goto: 4 times, last 0 s ago: expected role operator")
    assert second.text.startswith("observer@uav3: sys/tree/set: 1 times")


async def test_member_forwarding_false_frames_is_named_with_remedy(tmp_path: Path) -> None:
    config_dir = make_node(tmp_path)
    async with Module("broker", config_dir=config_dir) as broker:
        denials = broker.stream_writer("net/denials", Denial, kind="event")
        denials.write(Denial("uav2", "node", "forward", "cmd/goto", 7, "frame of gcs: not signed"))
        (found,) = await examined(config_dir, "denied")
    assert found.text == "node@uav2: cmd/goto: 7 times, last 0 s ago: frame of gcs: not signed"
    assert "revoke it" in found.advice


async def test_member_relaying_false_values_is_named_with_remedy(tmp_path: Path) -> None:
    config_dir = make_node(tmp_path)
    async with Module("broker", config_dir=config_dir) as broker:
        denials = broker.stream_writer("net/denials", Denial, kind="event")
        denials.write(Denial("uav2", "node", "relay", "/uav3/nav/pose", 9, "forged by uav2"))
        (found,) = await examined(config_dir, "denied")
    assert found.text == "node@uav2: /uav3/nav/pose: 9 times, last 0 s ago: forged by uav2"
    assert "unless other nodes deny one from which it takes these values" in found.advice


def test_file_of_access_rules_is_checked_by_line(tmp_path: Path) -> None:
    config_dir = make_node(tmp_path)

    def found() -> CheckResult:
        return next(one for one in examine({"uav1": config_dir}, fix=False) if one.check == FILE)

    assert found().verdict == "ok"
    (config_dir / FILE).write_text('[[rule]]\nverb = "get"\npath = "**"\nrole = "admiral"\n')
    assert found().verdict == "error"
    assert "acl.toml: line 4: key rule[0].role" in found().text
    assert "'admiral'" in found().text
    assert [problem for problem in effective_config(config_dir, {}, {}).problems if "admiral" in problem]


async def test_many_refused_senders_are_counted_not_listed(tmp_path: Path) -> None:
    config_dir = make_node(tmp_path)
    async with Module("broker", config_dir=config_dir) as broker:
        denials = broker.stream_writer("net/denials", Denial, kind="event")
        for number in range(20):
            denials.write(Denial(f"uav{number}", "node", "call", "cmd/goto", 2, "expected role operator"))
        found = await examined(config_dir, "denied")
    assert len(found) == 9
    assert found[-1].text == "24 times in 12 other cases"


async def test_confirmed_faults_are_shown_with_observation(tmp_path: Path) -> None:
    config_dir = make_node(tmp_path)
    full = Fault("logger/disk", "full", "warn", Phase.CONFIRMED, 1, 2, 1, "/data/log: no space left")
    away = Fault("age/nav/pose", "lost", "error", Phase.CONFIRMED, 1, 2, 1, "3.1", "none for 3 s")
    over = Fault("logger/mongodb", "slow", "warn", Phase.HEALED, 1, 2, 1)
    faults = [full, away, over]

    async with Module("health", config_dir=config_dir) as health:
        health.serve(
            "sys/health/faults",
            FaultQuery,
            lambda *_: FaultList("uav1", 3, tuple(faults)),
            reply=FaultList,
        )
        shown = await examined(config_dir, "fault", "faults")
        faults.clear()
        well = await examined(config_dir, "fault", "faults")
    assert [(one.verdict, one.text) for one in shown] == [
        ("warning", "logger/disk: full: /data/log: no space left"),
        ("error", "age/nav/pose: lost: none for 3 s: 3.1"),
    ]
    assert [(one.verdict, one.check) for one in well] == [("ok", "faults")]


async def test_faults_of_other_computers_show_their_name(tmp_path: Path) -> None:
    config_dir = make_node(tmp_path)
    routes = (RouteState("uav1", 1, "uav1.fc", 256, 1, 1, 0, "fc"), RouteState("gcs", 1, "gcs", 256, 1, 1, 0))
    fault = Fault("app/hal", "died", "error", Phase.CONFIRMED, 1, 2, 1, "exit code 9")
    async with (
        Module("broker", config_dir=config_dir) as broker,
        Module("health", config_dir=config_dir) as m,
    ):
        broker.serve("sys/broker/routes", Empty, lambda *_: Routes(routes), reply=Routes)
        m.serve("sys/health/faults", FaultQuery, lambda *_: FaultList("uav1", 3, (fault,)), reply=FaultList)
        own, other = await examined(config_dir, "fault", "faults")
    assert (own.verdict, own.text) == ("error", "uav1.main: app/hal: died: exit code 9")
    assert own.advice == "swarmctl health faults -n uav1.main"
    assert other.verdict == "error"
    assert other.text.startswith("uav1.fc: ")


async def test_monitor_that_does_not_answer_is_error(tmp_path: Path) -> None:
    config_dir = make_node(tmp_path)
    async with Module("health", config_dir=config_dir):
        (found,) = await examined(config_dir, "fault", "faults")
    assert found.verdict == "error"
    assert "sys/health/faults" in found.text


async def test_members_without_route_are_named_with_remedy(tmp_path: Path) -> None:
    config_dir = make_node(tmp_path)
    members = tuple(
        RosterMemberState(name, "node", serial, revoked=name == "uav4")
        for serial, name in enumerate(("uav1", "uav2", "uav3", "uav4"))
    )
    routes = [RouteState("uav2", 1, "uav2", 256, 1, 1, 0)]

    async with Module("broker", config_dir=config_dir) as broker:
        broker.writer("net/roster", RosterState).write(RosterState(2, 0, "swarm", "f", members))
        broker.serve("sys/broker/routes", Empty, lambda *_: Routes(tuple(routes)), reply=Routes)
        (found,) = await examined(config_dir, "members")
        assert (found.verdict, found.text) == ("warning", "members that this node does not reach: uav3")
        assert "firewall" in found.advice
        routes.append(RouteState("uav3", 1, "uav2", 512, 2, 1, 0))
        (found,) = await examined(config_dir, "members")
        assert (found.verdict, found.text) == ("ok", "all 2 other members are reached")


async def test_flight_loop_without_real_time_is_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config_dir = make_node(tmp_path / "plain", airframe="quad_1k5")
    assert await examined(config_dir, "flight loop") == [], "hal does not run"
    async with Module("hal", config_dir=config_dir):
        (found,) = await examined(config_dir, "flight loop")
        assert found.verdict == "warning"
        assert "other work delays the flight loop" in found.text
        assert "[realtime] services = { hal = 50 } in node.toml" in found.advice
        monkeypatch.setattr(os, "sched_getscheduler", lambda _: os.SCHED_FIFO | 0x40000000)
        monkeypatch.setattr(os, "sched_getparam", lambda _: os.sched_param(50))
        (found,) = await examined(config_dir, "flight loop")
        assert (found.verdict, found.text) == ("ok", "hal: SCHED_FIFO 50")


async def test_flight_loop_with_refused_scheduling_is_distinguished(tmp_path: Path) -> None:
    config_dir = make_node(
        tmp_path, airframe="quad_1k5", services={"hal": {}}, realtime={"services": {"hal": 50}}
    )
    async with Module("hal", config_dir=config_dir):
        (found,) = await examined(config_dir, "flight loop")
    assert found.text == "hal runs without the real-time scheduling that node.toml declares"


async def test_vehicle_without_airframe_has_no_flight_loop(tmp_path: Path) -> None:
    config_dir = make_node(tmp_path)
    async with Module("hal", config_dir=config_dir):
        assert await examined(config_dir, "flight loop") == []


async def test_invalid_file_among_applications_is_named(tmp_path: Path) -> None:
    config_dir = make_node(tmp_path)
    async with Module("planner", config_dir=config_dir) as planner:
        strange = planner.node.run_dir / "apps/x#1.toml"
        strange.mkdir()
        (found,) = await examined(config_dir, "applications")
    assert (found.verdict, found.text) == ("warning", f"{strange}: a folder; expected a regular file")
