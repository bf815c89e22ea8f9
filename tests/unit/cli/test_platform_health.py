"""The worst computer of a platform decides the health of the platform."""

from typing import Any

import pytest
from tests.unit.cli.session import COPY, ScriptedSession

from swarmctl.commands.health.report import list_states
from swarmctl.resources.platform_health import merged
from swarmware.errors import NoAnswer
from swarmware.types import registry
from swarmware.types.health import HealthState
from swarmware.types.net import Routes, RouteState
from swarmware.types.tree import Quality, TreeValue

WELL = HealthState("ok", "ok", 0.9, {"sensor/gnss": True}, checks=4, apps_alive=6, guard="alive")
ILL = HealthState(
    "error",
    sensors={"nav/pose": False},
    faults=("app/estimator=died",),
    fault_count=1,
    checks=3,
    apps_alive=4,
    apps_failed=1,
    guard="hung",
)
WARM = HealthState("warn", faults=("limit/system/load=warm",), fault_count=1, apps_alive=2, guard="alive")


def copied(computer: str, state: HealthState) -> dict[str, Any]:
    path = f"/{computer}/health/state"
    value = TreeValue(path, "HealthState", registry.encode(state), 1, 1, 1, 0.2, Quality.LIVE)
    return {f"{COPY} {path}": value}


class SessionWithUnits(ScriptedSession):
    """A session whose node has routes to these computers of uav1."""

    def __init__(self, units: tuple[str, ...], answers: dict[str, Any]) -> None:
        super().__init__(answers, node="uav1", output="json")
        self.units = units

    async def routes(self) -> Routes:
        return Routes(tuple(RouteState("uav1", 1, "uav1", 256, 1, 1, 0, unit) for unit in self.units))

    async def reach(self, platform: str) -> None:
        assert platform.partition(".")[0] == "uav1"


def test_worst_computer_decides_and_is_listed_first() -> None:
    state = merged({"fc": WARM, "main": WELL, "nav": ILL})
    assert (state.level, state.guard) == ("error", "hung")
    assert (state.battery, state.battery_ratio) == ("ok", 0.9)
    assert state.sensors == {"sensor/gnss": True, "nav/pose": False}
    assert state.faults == ("nav: app/estimator=died", "fc: limit/system/load=warm")
    assert (state.fault_count, state.checks, state.apps_alive, state.apps_failed) == (2, 7, 12, 1)


def test_silent_computer_is_error_of_platform() -> None:
    state = merged({"fc": None, "main": WELL})
    assert (state.level, state.faults, state.fault_count) == ("error", ("fc: no answer",), 1)


async def test_the_list_of_platforms_has_the_merged_state() -> None:
    found = SessionWithUnits(("main", "nav"), copied("uav1.main", WELL) | copied("uav1.nav", ILL))
    await list_states(found)
    (row,) = found.document["platforms"]
    assert row["state"]["level"] == "error"
    assert row["state"]["faults"] == ["nav: app/estimator=died"]


async def test_single_computer_shows_its_own_state() -> None:
    found = SessionWithUnits(("main",), copied("uav1", ILL))
    await list_states(found)
    assert found.document["platforms"][0]["state"]["faults"] == ["app/estimator=died"]


async def test_fully_silent_platform_has_first_error() -> None:
    silent = {f"{COPY} /uav1.{unit}/health/state": NoAnswer(f"{unit} is silent") for unit in ("nav", "fc")}
    with pytest.raises(NoAnswer, match="fc is silent"):
        await list_states(SessionWithUnits(("nav", "fc"), silent))
