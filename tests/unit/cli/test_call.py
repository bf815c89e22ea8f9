"""`swarmctl call`: what is sent for which words, and what is printed of the answer."""

from typing import Any

import click
import msgspec
import pytest
from tests.unit.cli.session import LIST, ScriptedSession

from swarmctl.commands.call.request import call_resource
from swarmctl.resources.entering import entered
from swarmware.errors import Denied, InvalidInput, NoAnswer, NotFound, OutOfRange, SwarmError, TypeMismatch
from swarmware.model.resource import Kind
from swarmware.testing.client import FakeClient
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.types.described import class_of
from swarmware.types.description import FieldDescription, StructDescription, TypeDescription
from swarmware.types.mission import MissionAbort
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.rpc import Empty
from swarmware.types.scalar import Float, Text
from swarmware.types.tree import TreeEntry, TreeListing
from swarmware.types.vehicle import ArmRequest, VehicleState

ARM = "/uav1/sys/vehicle/arm"
GOTO = "/uav1/cmd/goto"


class Recording(ScriptedSession):
    """A session that keeps the values of requests, and whose module keeps messages."""

    def __init__(self, entry: TreeEntry, answer: Any, outcome: Outcome | None = None, **options: Any) -> None:
        client = FakeClient()
        super().__init__({LIST: TreeListing((entry,)), entry.path: answer}, client, **options)
        self.sent: list[msgspec.Struct] = []
        self.client = client
        if outcome is not None:
            client.outcome = outcome

    async def ask(self, path: str, value: msgspec.Struct, reply: type[Any], **more: Any) -> Any:
        if "sys/tree/" not in path:
            self.sent.append(value)
        return await super().ask(path, value, reply, **more)


def command(path: str = ARM, kind: str = "ArmRequest", reply: str = "", **more: Any) -> TreeEntry:
    return TreeEntry(path, Kind.COMMAND, kind, access="rw", reply=reply, **more)


@pytest.mark.parametrize(
    ("cls", "words", "value"),
    [
        (ArmRequest, ("armed=true",), ArmRequest(True)),
        (ArmRequest, ('{"armed": true}',), ArmRequest(True)),
        (ArmRequest, ("[true]",), ArmRequest(True)),
        (MissionAbort, ("reason=5", "then=hold"), MissionAbort("5", "hold")),
        (Empty, (), Empty()),
        (Goal, ("seq=1", "kind=goto", "x_m=-2.5"), Goal(1, GoalKind.GOTO, -2.5)),
        (
            Goal,
            ("seq=1", "kind=formation", "offset_m=[1,2,0]"),
            Goal(1, GoalKind.FORMATION, offset_m=(1, 2, 0)),
        ),
        (Float, ("-3",), Float(-3.0)),
        (Float, ("value=2",), Float(2.0)),
        (Text, ("5",), Text("5")),
        (Text, ("a=b",), Text("a=b")),
        (Text, ("value=true",), Text("true")),
    ],
)
def test_words_become_a_value_of_the_type(
    cls: type[msgspec.Struct], words: tuple[str, ...], value: msgspec.Struct
) -> None:
    assert entered(cls, words, "p") == value


@pytest.mark.parametrize(
    ("cls", "words", "error", "said"),
    [
        (ArmRequest, (), TypeMismatch, "p: field 'armed' of ArmRequest is missing"),
        (ArmRequest, ("armed=5",), TypeMismatch, "p.armed: expected `bool`, got `int` (it is 5)"),
        (ArmRequest, ("arm=true",), TypeMismatch, "no field 'arm' in ArmRequest; expected some of armed"),
        (ArmRequest, ("armed=true", "now"), InvalidInput, "value 'now'; expected one value, or each word as"),
        (ArmRequest, ("armed=true", "armed=false"), InvalidInput, "field 'armed' is given twice"),
        (ArmRequest, ("armed=true", "armed.x=1"), InvalidInput, "given as a whole and in parts"),
        (Float, ("fast",), TypeMismatch, "p: expected `float`, got `str` (it is 'fast')"),
        (ArmRequest, ("[" * 100_000,), InvalidInput, "nested too deep"),
    ],
)
def test_words_outside_type_are_refused_with_place(
    cls: type[msgspec.Struct], words: tuple[str, ...], error: type[SwarmError], said: str
) -> None:
    with pytest.raises(error) as caught:
        entered(cls, words, "p")
    assert said in str(caught.value)


def test_nested_fields_are_given_by_name() -> None:
    gust = StructDescription("Gust", (FieldDescription("speed_m_s", "float"),), array=True)
    fields = (FieldDescription("gust", "Gust"), FieldDescription("name", "str"))
    cls = class_of(TypeDescription((StructDescription("Weather", fields, array=True), gust)))
    value = entered(cls, ("gust.speed_m_s=3", "name=7"), "p")
    assert msgspec.msgpack.encode(value) == msgspec.msgpack.encode([[3.0], "7"])


async def test_request_is_sent_and_answer_printed_with_names() -> None:
    state = VehicleState(True, False)
    session = Recording(command(reply="VehicleState"), state, node="uav1")
    await call_resource(session, "sys/vehicle/arm", ("armed=true",), yes=False)
    assert session.sent == [ArmRequest(True)]
    assert session.stdout.getvalue() == "  armed   true\n  landed  false\n  mode    auto\n"
    session = Recording(command(reply="VehicleState"), state, output="json")
    await call_resource(session, ARM, ("armed=true",), yes=False)
    document = session.document
    assert (document["path"], document["type"], document["value"]["armed"]) == (ARM, "VehicleState", True)


async def test_answer_without_fields_is_done_single_printed_alone() -> None:
    session = Recording(command(reply="Empty"), Empty())
    await call_resource(session, ARM, ("armed=true",), yes=False)
    assert session.stdout.getvalue() == f"{ARM}: done\n"
    session = Recording(command(reply="Float"), Float(2.5))
    await call_resource(session, ARM, ("armed=true",), yes=False)
    assert session.stdout.getvalue().strip() == "2.5"


async def test_dangerous_request_is_sent_only_after_answer() -> None:
    entry = command(reply="VehicleState", confirm="motors may turn")
    session = Recording(entry, VehicleState(True, False))
    with pytest.raises(click.UsageError, match="call sys/vehicle/arm: motors may turn: expected --yes"):
        await call_resource(session, ARM, ("armed=true",), yes=False)
    assert session.sent == []
    await call_resource(session, ARM, ("armed=true",), yes=True)
    assert session.sent == [ArmRequest(True)]


async def test_reason_of_refusal_is_raised_as_owners_error() -> None:
    session = Recording(command(reply="VehicleState"), Denied("uav1: battery low; expected above 20 %"))
    with pytest.raises(Denied, match="battery low"):
        await call_resource(session, ARM, ("armed=true",), yes=False)


@pytest.mark.parametrize(
    ("outcome", "error", "said"),
    [
        (Outcome(Status.DELIVERED, "uav1:hello"), None, f"{GOTO}: delivered to uav1:hello\n"),
        (Outcome(Status.REFUSED, "uav1", "no inbox"), Denied, "refused at uav1: no inbox"),
        (Outcome(Status.EXPIRED, "", "no answer"), NoAnswer, "expired: no answer"),
    ],
)
async def test_command_without_answer_prints_outcome_of_message(
    outcome: Outcome, error: type[SwarmError] | None, said: str
) -> None:
    session = Recording(command(GOTO, "Goal"), None, outcome)
    words = ("seq=1", "kind=goto")
    if error is None:
        await call_resource(session, GOTO, words, yes=False)
        assert session.stdout.getvalue() == said
    else:
        with pytest.raises(error, match=said):
            await call_resource(session, GOTO, words, yes=False)
    assert session.client.sent == [(GOTO, Goal(1, GoalKind.GOTO))]


@pytest.mark.parametrize(
    ("entry", "words", "error", "said"),
    [
        (
            TreeEntry(ARM, Kind.BOARD, "Pose"),
            (),
            InvalidInput,
            "a board; expected a command (`swarmctl tree get`",
        ),
        (
            TreeEntry(ARM, Kind.SETTING, "Float"),
            ("1",),
            InvalidInput,
            "a setting; .*`swarmctl tree set` sets it",
        ),
        (command(ARM, "Float", range=(0.0, 2.0)), ("3",), OutOfRange, "3; expected 0 to 2"),
        (
            command(ARM, "Nobody"),
            (),
            NotFound,
            "type 'Nobody': not installed here, and uav1 does not describe",
        ),
    ],
)
async def test_uncallable_resource_is_refused_before_sending(
    entry: TreeEntry, words: tuple[str, ...], error: type[SwarmError], said: str
) -> None:
    session = Recording(entry, None)
    session.answers = {**session.answers, "/gcs/sys/tree/type /uav1/sys/tree/type": NotFound("type")}
    with pytest.raises(error, match=said.replace("(", r"\(")):
        await call_resource(session, ARM, words, yes=False)
    assert session.sent == []
