"""Nodes that are drained, and what is said of a node that does not answer."""

from types import SimpleNamespace
from typing import Any

import click
import command_schemas
import jsonschema
import msgspec
import pytest
from tests.unit.cli.session import COPY, ScriptedSession
from tests.unit.tree.neighbours import neighbour

from swarmctl.commands.node import draining
from swarmctl.commands.node.identity import show_node
from swarmctl.main import main as swarmctl
from swarmctl.resources.last_values import last_values
from swarmctl.vehicles.observer import VehicleResult
from swarmware.errors import NoAnswer, NotFound
from swarmware.model.platform_kind import PlatformKind
from swarmware.types import registry
from swarmware.types.mission import DrainOrder, MissionAbort, MissionPhase, MissionState, MissionStatus
from swarmware.types.net import Neighbours
from swarmware.types.system import NodeInfo
from swarmware.types.tree import Quality, TreeValue
from swarmware.types.vehicle import Pose

STATUS, DRAIN = "sys/mission/status", "sys/mission/drain"
IDLE = MissionState(0, "", MissionPhase.IDLE, kind=PlatformKind.UAV)
RUNNING = MissionState(7, "00ab12cd", MissionPhase.RUNNING, mission="formation", kind=PlatformKind.UAV)


class Vehicle(ScriptedSession):
    """A vehicle whose mission ends at the end of `states`."""

    def __init__(self, *states: MissionState, **options: Any) -> None:
        super().__init__({}, node="uav1", **options)
        self.states = list(states)
        self.drained_by = ""

    async def ask(self, path: str, value: msgspec.Struct, reply: type[Any], **rest: Any) -> Any:
        self.asked.append(path)
        if path == DRAIN:
            assert isinstance(value, DrainOrder)
            self.drained_by = "ann@gcs" if value.drained else ""
        state = msgspec.structs.replace(self.states[0], drained_by=self.drained_by)
        return MissionStatus("uav1", state, "", 0)


@pytest.fixture(autouse=True)
def observed(monkeypatch: pytest.MonkeyPatch) -> list[MissionAbort]:
    """The board of the vehicle changes at each look; orders of built-in missions are recorded."""
    ordered: list[MissionAbort] = []

    class Observer:
        def __init__(self, session: Vehicle, kinds: dict[str, PlatformKind]) -> None:
            self.session = session

        def snapshot(self, platform: str) -> Any:
            return SimpleNamespace(mission=self.session.states[0])

        async def changed(self) -> None:
            if len(self.session.states) > 1:
                self.session.states.pop(0)
            else:
                raise TimeoutError

    async def manoeuvre(
        session: Vehicle, order: MissionAbort, chosen: dict[str, PlatformKind], wait_s: float
    ) -> list[VehicleResult]:
        ordered.append(order)
        session.states[:] = [IDLE]
        return [VehicleResult("uav1", True, True, "landed", 1.0)]

    async def kinds(session: Vehicle) -> dict[str, PlatformKind]:
        return {"uav1": PlatformKind.UAV}

    monkeypatch.setattr(draining, "VehicleObserver", Observer)
    monkeypatch.setattr(draining, "manoeuvre", manoeuvre)
    monkeypatch.setattr(draining, "kinds", kinds)
    return ordered


async def test_idle_node_is_drained_at_once_and_undrained() -> None:
    for output in ("table", "json"):
        session = Vehicle(IDLE, output=output)
        await draining.drain(session, 1.0, now=False, yes=False)
        if output == "json":
            jsonschema.validate(session.document, command_schemas.schema("node drain"))
            assert session.document["drained_by"] == "ann@gcs"
        else:
            assert session.stdout.getvalue().splitlines()[1].split() == [
                "uav1",
                "drained",
                "by",
                "ann@gcs",
                "idle",
            ]
        again = Vehicle(IDLE)
        await draining.undrain(again)
        assert "takes missions" in again.stdout.getvalue()


async def test_drain_waits_for_end_of_running_mission(observed: list[MissionAbort]) -> None:
    session = Vehicle(RUNNING, RUNNING, IDLE)
    await draining.drain(session, 5.0, now=False, yes=False)
    assert "its mission formation still runs" in session.stderr.getvalue()
    assert session.stdout.getvalue().splitlines()[1].split()[-1] == "idle"
    assert observed == []


async def test_mission_overtime_is_error_and_node_stays_drained() -> None:
    session = Vehicle(RUNNING)
    with pytest.raises(NoAnswer, match="uav1: drained, but its mission has not ended within 5 s"):
        await draining.drain(session, 5.0, now=False, yes=False)
    assert session.drained_by == "ann@gcs"


async def test_running_mission_is_ended_only_after_confirmation(
    observed: list[MissionAbort], monkeypatch: pytest.MonkeyPatch
) -> None:
    refused = Vehicle(RUNNING)
    monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=lambda: False))
    with pytest.raises(click.UsageError, match="uav1: drain and end formation: it lands: expected --yes"):
        await draining.drain(refused, 5.0, now=True, yes=False)
    assert (refused.drained_by, observed) == ("", [])
    session = Vehicle(RUNNING)
    await draining.drain(session, 5.0, now=True, yes=True)
    assert [(order.then, order.reason) for order in observed] == [("land", "drained by ann@gcs")]


@pytest.mark.parametrize("verb", ["drain", "undrain"])
def test_unnamed_node_is_not_the_joined_one(verb: str) -> None:
    assert swarmctl(["node", verb]) == click.UsageError.exit_code


# -- a node that does not answer


POSE = Pose(1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)


class Silent(ScriptedSession):
    """A vehicle that does not answer, with or without a route; the joined node keeps its pose."""

    def __init__(
        self, *, route: bool, kept: bool = True, silent_s: float | None = None, **options: Any
    ) -> None:
        super().__init__({}, node="uav1", **options)
        self.route = route
        self.kept = kept
        self.silent_s = silent_s

    async def in_reach(self, platform: str) -> bool:
        return self.route

    async def ask(self, path: str, value: msgspec.Struct, reply: type[Any], **rest: Any) -> Any:
        if reply is Neighbours and self.silent_s is not None:
            near, other = neighbour("uav1", "down"), neighbour("uav2", "up")
            return Neighbours((msgspec.structs.replace(near, silent_s=self.silent_s), other))
        if path != COPY:
            raise NoAnswer(f"/uav1/{path}: uav1 does not answer")
        wanted = getattr(value, "path", "")
        if not self.kept or not wanted.endswith("nav/pose"):
            raise NotFound(wanted)
        return TreeValue(wanted, "Pose", registry.encode(POSE), 1, 1, 1, 12.5, Quality.LOST)


@pytest.mark.parametrize("route", [False, True])
@pytest.mark.parametrize("kept", [False, True])
async def test_unanswering_node_is_shown_with_last_state(route: bool, kept: bool) -> None:
    session = Silent(route=route, kept=kept, output="json")
    with pytest.raises(NoAnswer) as caught:
        await show_node(session)
    jsonschema.validate(session.document, command_schemas.schema("node info"))
    found = session.document
    assert (found["platform"], found["answers"], found["services"]) == ("uav1", False, None)
    assert found["reason"] == str(caught.value) != ""
    assert found["last"]["seen_s"] == (12.5 if kept else None)
    assert (found["last"]["pose"] or {"z_m": None})["z_m"] == (3.0 if kept else None)
    shown = Silent(route=route, kept=kept)
    with pytest.raises(NoAnswer):
        await show_node(shown)
    assert ("2.0 m north" in shown.stdout.getvalue()) is kept


@pytest.mark.parametrize(("silent_s", "since_s"), [(None, 12.5), (3.0, 3.0), (40.0, 12.5)])
async def test_vehicle_is_lost_since_its_last_beacon(silent_s: float | None, since_s: float) -> None:
    session = Silent(route=False, silent_s=silent_s)
    assert (await last_values(session, "uav1")).seen_s == since_s


async def test_document_of_node_has_one_form() -> None:
    info = NodeInfo(
        "uav1", "main", PlatformKind.UAV, "multirotor", "0.1", 2**60, 1.0, (), "/etc/swarm", "one"
    )
    session = ScriptedSession({"sys/node/info": info}, node="uav1", output="json")
    await show_node(session)
    lost = Silent(route=False, output="json")
    with pytest.raises(NoAnswer):
        await show_node(lost)
    assert session.document.keys() == lost.document.keys()
    assert (session.document["answers"], session.document["last"], session.document["reason"]) == (
        True,
        None,
        "",
    )
    assert session.document["boot_id"] == str(2**60)
