"""Restarts by the guard: what an armed vehicle flies with is refused, and the end is seen, not assumed."""

from typing import Any

import click
import msgspec
import pytest
from tests.unit.cli.session import GET, ScriptedSession

from swarmctl.resources import restart as restarting
from swarmctl.resources.restart import restart
from swarmware.errors import Denied, NoAnswer, NotFound
from swarmware.types import registry
from swarmware.types.health import GuardStatus, ServiceState, SupervisorKind, WatchedService
from swarmware.types.tree import TreeValue
from swarmware.types.vehicle import VehicleState

STATUS, RESTART = "/uav1/sys/guard/status", "/uav1/sys/guard/restart"
STATE = f"{GET} /uav1/vehicle/state"


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(restarting, "POLL_S", 0.0)


class Guarded(ScriptedSession):
    """A node whose guard restarts a service between two questions."""

    def __init__(self, *, armed: bool, **options: Any) -> None:
        self.restarts = {"navigator": 0, "logger": 0}
        self.revives = True
        data = registry.encode(VehicleState(armed, True))
        state = TreeValue("/uav1/vehicle/state", "VehicleState", data, 1, 1, 1, 0.1, "live")  # type: ignore[arg-type]
        super().__init__({STATE: state}, node="uav1", **options)

    async def ask(self, path: str, value: msgspec.Struct, reply: type[Any], **rest: Any) -> Any:
        if path == RESTART:
            self.asked.append(f"{path} {getattr(value, 'service', '')}")
            self.restarts[getattr(value, "service", "")] += self.revives
            return self.status
        if path == STATUS:
            return self.status
        return await super().ask(path, value, reply, **rest)

    @property
    def status(self) -> GuardStatus:
        found = [WatchedService(n, ServiceState.RUNNING, 7, count) for n, count in self.restarts.items()]
        return GuardStatus(SupervisorKind.SELF, tuple(found))


async def test_service_of_armed_vehicle_restarts_by_force() -> None:
    session = Guarded(armed=True)
    with pytest.raises(Denied, match="uav1 is armed and flies with navigator"):
        await restart(session, ("logger", "navigator"), 1.0, yes=True, force=False)
    assert session.restarts == {"navigator": 0, "logger": 0}
    await restart(session, ("logger",), 1.0, yes=True, force=False)
    await restart(session, ("navigator",), 1.0, yes=True, force=True)
    assert session.restarts == {"navigator": 1, "logger": 1}


async def test_nothing_is_restarted_before_the_operator_agrees() -> None:
    session = Guarded(armed=True)
    with pytest.raises(
        click.UsageError, match=r"uav1: restart navigator, with which the armed .*expected --yes"
    ):
        await restart(session, ("navigator",), 1.0, yes=False, force=True)
    assert session.restarts["navigator"] == 0


async def test_all_services_restart_in_order_and_print() -> None:
    session = Guarded(armed=False, output="json")
    await restart(session, (), 1.0, yes=True, force=False)
    assert [one["name"] for one in session.document["services"]] == ["navigator", "logger"]
    assert {one["restarts"] for one in session.document["services"]} == {1}


async def test_service_that_does_not_run_again_is_error() -> None:
    session = Guarded(armed=False)
    session.revives = False
    with pytest.raises(NoAnswer, match=r"logger of uav1: does not run again within 0.05 s"):
        await restart(session, ("logger",), 0.05, yes=True, force=False)


async def test_unknown_service_is_reported_before_question() -> None:
    session = Guarded(armed=False)
    with pytest.raises(NotFound, match=r"'gps' of uav1: .* expected one of navigator, logger"):
        await restart(session, ("gps",), 1.0, yes=False, force=False)
