"""Services that an operator stops and starts: what is refused, what is asked, and that the end is seen."""

from typing import Any

import click
import command_schemas
import jsonschema
import msgspec
import pytest
from tests.unit.cli.session import GET, ScriptedSession

from swarmctl.commandline import completion, completion_cache
from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.app import stopping
from swarmctl.commands.app.listing import list_applications
from swarmware.errors import Denied, NoAnswer, NotFound
from swarmware.testing.client import FakeClient
from swarmware.types import registry
from swarmware.types.health import GuardStatus, ServiceState, SupervisorKind, WatchedService
from swarmware.types.register import Application, ApplicationTable, KnownUnit, Register
from swarmware.types.tree import TreeValue
from swarmware.types.vehicle import VehicleState

STATE = f"{GET} /uav1/vehicle/state"


class LaterClient(FakeClient):
    """A client for which 0.1 s pass between two looks at the clock."""

    def __init__(self) -> None:
        super().__init__()
        self.clock_ns = 0

    def now_ns(self) -> int:
        self.clock_ns += 100_000_000
        return self.clock_ns


class Guarded(ScriptedSession):
    """A node whose guard stops and starts services between two questions."""

    def __init__(
        self, *, armed: bool = False, supervisor: SupervisorKind = SupervisorKind.SELF, **options: Any
    ):
        self.states = dict.fromkeys(("broker", "navigator", "logger"), ServiceState.RUNNING)
        self.supervisor = supervisor
        self.obeys = True
        data = registry.encode(VehicleState(armed, True))
        state = TreeValue("/uav1/vehicle/state", "VehicleState", data, 1, 1, 1, 0.1, "live")  # type: ignore[arg-type]
        super().__init__({STATE: state}, LaterClient(), node="uav1", **options)

    async def ask(self, path: str, value: msgspec.Struct, reply: type[Any], **rest: Any) -> Any:
        verb = path.rpartition("sys/guard/")[2]
        if verb in {"stop", "start"}:
            self.asked.append(f"{verb} {getattr(value, 'service', '')}")
            if self.obeys:
                now = ServiceState.STOPPED if verb == "stop" else ServiceState.RUNNING
                self.states[getattr(value, "service", "")] = now
        elif verb != "status":
            return await super().ask(path, value, reply, **rest)
        found = [
            WatchedService(name, state, 7, stopped_by="ann@gcs" if state == ServiceState.STOPPED else "")
            for name, state in self.states.items()
        ]
        return GuardStatus(self.supervisor, tuple(found))


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stopping, "POLL_S", 0.0)


async def test_services_are_stopped_started_and_shown() -> None:
    session = Guarded()
    await stopping.stop(session, ("logger",), 5.0, yes=True, force=False)
    assert session.stdout.getvalue().splitlines()[1].split() == ["logger", "stopped", "by", "ann@gcs", "7"]
    shown = Guarded(output="json")
    await stopping.start(shown, ("logger", "navigator"), 5.0)
    jsonschema.validate(shown.document, command_schemas.schema("app start"))
    assert [one["state"] for one in shown.document["services"]] == ["running", "running"]
    assert session.asked[-1] == "stop logger"
    assert shown.asked == ["start logger", "start navigator"]


@pytest.mark.parametrize(
    ("names", "options", "error", "text"),
    [
        (("broker",), {}, Denied, "uav1: service 'broker': cannot be stopped: .*reached through it"),
        (("guard",), {}, Denied, "'guard': cannot be stopped: it starts the others again"),
        (("gps",), {}, NotFound, "'gps' of uav1: .*expected one of broker, navigator, logger"),
        (("navigator", "logger"), {"armed": True}, Denied, "armed and flies with navigator; .*--force"),
        (("logger",), {"supervisor": SupervisorKind.SYSTEMD}, Denied, "systemctl stop swarmd@logger"),
    ],
)
async def test_unstoppable_service_is_refused_before_question(
    names: tuple[str, ...], options: dict[str, Any], error: type[Exception], text: str
) -> None:
    session = Guarded(**options)
    with pytest.raises(error, match=text):
        await stopping.stop(session, names, 5.0, yes=False, force=False)
    assert not any(asked.startswith("stop") for asked in session.asked)


async def test_operator_is_asked_before_service_is_stopped() -> None:
    session = Guarded(armed=True)
    with pytest.raises(click.UsageError, match=r"uav1: stop navigator, with .*expected --yes"):
        await stopping.stop(session, ("navigator",), 5.0, yes=False, force=True)
    assert session.states["navigator"] == ServiceState.RUNNING


async def test_service_that_does_not_stop_is_error() -> None:
    session = Guarded()
    session.obeys = False
    with pytest.raises(NoAnswer, match=r"logger \(running\) of uav1: not stopped within 0.5 s"):
        await stopping.stop(session, ("logger",), 0.5, yes=True, force=False)


async def test_list_of_applications_shows_who_stopped_service() -> None:
    for output in ("table", "json"):
        session = Guarded(output=output)
        session.states["logger"] = ServiceState.STOPPED
        table = ApplicationTable("uav1", "main", 1, 1, 1, "sim#1", 1, (Application("sim", 1, 9, 0),))
        session.answers = {"/uav1/sys/register/apps": Register((KnownUnit(table, 0, 0.0),))}
        await list_applications(session)
        if output == "json":
            assert session.document["stopped"] == [{"platform": "uav1", "service": "logger", "by": "ann@gcs"}]
        else:
            last = session.stdout.getvalue().splitlines()[-1]
            assert last.split()[:5] == ["uav1", "logger", "stopped", "by", "ann@gcs"]


async def test_applications_are_listed_while_register_is_stopped() -> None:
    session = Guarded()
    session.states["register"] = ServiceState.STOPPED
    table = ApplicationTable("uav1", "main", 1, 1, 1, "pid 9", 1, (Application("sim", 1, 9, 0),))
    session.answers = {
        "/uav1/sys/register/apps": NotFound("/uav1/sys/register/apps: refused at uav1"),
        "/gcs/sys/register/apps": Register((KnownUnit(table, 1, 0.5),)),
    }
    await list_applications(session)
    [row] = [line.split() for line in session.stdout.getvalue().splitlines() if "sim#1" in line]
    assert row[-1] == "yes", "its process is the master"
    assert "uav1: its service register does not run; shown as gcs knows it" in session.stderr.getvalue()
    session.answers = {"/gcs/sys/register/apps": NotFound("refused"), "/uav1/sys/register/apps": NotFound("")}
    with pytest.raises(NotFound, match="gcs: its service register does not run; expected"):
        await list_applications(session)


def test_services_are_completed_from_their_status_boards(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [
        completion_cache.CachedResource(f"/{platform}/app/{name}/status", "board", "r")
        for platform, name in (("uav1", "logger"), ("uav1", "sim"), ("uav2", "logger"), ("gcs", "swarmctl"))
    ]
    monkeypatch.setattr(completion_cache, "load", lambda: ("way", ["uav1"], rows))
    ctx = click.Context(click.Command("stop"), obj=CliSettings())
    assert completion.services(ctx, click.Argument(["services"]), "") == ["logger", "sim"]
    assert completion.services(ctx, click.Argument(["services"]), "s") == ["sim"]
