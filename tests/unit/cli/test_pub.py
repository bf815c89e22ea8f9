"""`swarmctl pub`: what is written, as which resource, and what is refused."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any
from weakref import WeakKeyDictionary

import click
import msgspec
import pytest
from tests.unit.cli.session import LIST, ScriptedSession

from swarmctl.commands.pub import publishing
from swarmctl.commands.pub.publishing import ValuesToPublish, publish
from swarmctl.session.session import NAME
from swarmware.errors import Conflict, Denied, InvalidInput, NotFound, OutOfRange, SwarmError, TypeMismatch
from swarmware.model.resource import Kind, Resource
from swarmware.node.node import Node
from swarmware.testing.client import FakeClient
from swarmware.types.description import FieldDescription, StructDescription, TypeDescription
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.scalar import Float, Int, Text
from swarmware.types.tree import TreeEntry, TreeListing

PATH = "/gcs/test/height"


SESSIONS: WeakKeyDictionary[Node, "Publishing"] = WeakKeyDictionary()
"""The session of each node, which keeps what is written there."""


@asynccontextmanager
async def joined(name: str, *, node: Any) -> AsyncIterator[Any]:
    """The module of the command, on the node of its session."""
    assert name == NAME
    yield SESSIONS[node]


@pytest.fixture(autouse=True)
def module_of_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(publishing, "Module", joined)


class Publishing(ScriptedSession):
    """A session on a node that keeps what is written."""

    def __init__(self, entry: TreeEntry | None = None, *, busy: bool = False, **options: Any) -> None:
        super().__init__({LIST: TreeListing(() if entry is None else (entry,))}, FakeClient(), **options)
        self.written: list[msgspec.Struct] = []
        self.resources: list[Resource] = []
        self.busy = busy
        self.wrote = asyncio.Event()
        SESSIONS[self.module.node] = self

    def writer(self, resource: Resource, cls: type[msgspec.Struct]) -> "Publishing":
        if self.busy:
            raise Conflict("process 1 writes this ring")
        self.resources.append(resource)
        return self

    stream_writer = writer

    @property
    def resource(self) -> Resource:
        return self.resources[-1]

    def write(self, value: msgspec.Struct) -> None:
        self.written.append(value)
        self.wrote.set()


def wanted(*words: str, **more: Any) -> ValuesToPublish:
    return ValuesToPublish(words, hold_s=0.0, **more)


@pytest.mark.parametrize(
    ("words", "more", "value"),
    [
        (("1.5",), {}, Float(1.5)),
        (("3",), {}, Int(3)),
        (("land",), {}, Text("land")),
        (("3",), {"type": "Float"}, Float(3.0)),
        (("seq=1", "kind=goto"), {"type": "Goal"}, Goal(1, GoalKind.GOTO)),
    ],
)
async def test_new_resource_has_type_of_value_or_name(
    words: tuple[str, ...], more: dict[str, str], value: msgspec.Struct
) -> None:
    session = Publishing()
    await publish(session, "test/height", wanted(*words, **more), yes=False)
    assert session.written == [value]
    assert (session.resources[0].path, session.resources[0].kind) == ("test/height", Kind.BOARD)
    assert session.stdout.getvalue() == f"{PATH}: 1 value of type {type(value).__name__} published\n"


async def test_ownerless_template_resource_keeps_its_description() -> None:
    entry = TreeEntry(PATH, Kind.EVENT, "Float", unit="m", range=(0.0, 9.0), access="rw")
    session = Publishing(entry)
    await publish(session, PATH, wanted("3"), yes=False)
    (resource,) = session.resources
    assert (resource.kind, resource.type, resource.unit, resource.range) == (Kind.EVENT, "Float", "m", (0, 9))
    with pytest.raises(OutOfRange, match="10 m; expected 0 to 9 m"):
        await publish(session, PATH, wanted("10"), yes=False)
    with pytest.raises(TypeMismatch, match="of type Float; expected it, not --type Int"):
        await publish(session, PATH, wanted("3", type="Int"), yes=False)


async def test_former_commands_remains_do_not_determine_type() -> None:
    session = Publishing(TreeEntry(PATH, Kind.EVENT, "Int", owner="swarmctl"))
    await publish(session, PATH, wanted("2.5"), yes=False)
    assert session.written == [Float(2.5)]
    assert session.resources[0].kind is Kind.BOARD


async def test_values_repeat_at_rate_and_are_counted() -> None:
    session = Publishing(output="json")
    await publish(session, PATH, wanted("1.5", rate_hz=1000.0, count=4), yes=False)
    assert session.written == [Float(1.5)] * 4
    assert session.resources[0].rate_hz == 1000.0
    document = session.document
    assert (document["values"], document["kind"], document["type"]) == (4, "board", "Float")
    assert document["duration_s"] >= 0.003


async def test_published_values_are_printed_after_interruption() -> None:
    session = Publishing(output="json")
    task = asyncio.create_task(publish(session, PATH, wanted("1.5", rate_hz=0.01), yes=False))
    await session.wrote.wait()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert session.document["values"] == 1, "the first value does not wait for a period"


async def test_type_that_only_another_platform_describes_is_published() -> None:
    fields = (FieldDescription("fallen_m", "float"), FieldDescription("of", "str"))
    described = TypeDescription((StructDescription("Rain", fields, array=True),))
    session = Publishing()
    ask = "/gcs/sys/tree/type"
    session.answers = {
        **session.answers,
        f"{ask} {ask}": NotFound("type"),
        f"{ask} /uav1/sys/tree/type": described,
    }
    await publish(session, PATH, wanted("fallen_m=2", "of=hail", type="Rain"), yes=False)
    assert msgspec.msgpack.encode(session.written[0]) == msgspec.msgpack.encode([2.0, "hail"])


@pytest.mark.parametrize(
    ("path", "entry", "words", "error", "said"),
    [
        ("/uav1/test/x", None, ("1",), Denied, "of another node; expected a path of gcs, or --config"),
        (PATH, TreeEntry(PATH, Kind.BOARD, "Float", owner="hal"), ("1",), Denied, "belongs to hal; expected"),
        (PATH, TreeEntry(PATH, Kind.SETTING, "Float"), ("1",), InvalidInput, "a setting; .*config set"),
        (PATH, TreeEntry(PATH, Kind.COMMAND, "Goal"), ("1",), InvalidInput, "a command; .*swarmctl call"),
        (PATH, TreeEntry(PATH, Kind.FILE, ""), ("1",), InvalidInput, "a file; expected a board"),
        (PATH, None, ("x_m=1",), InvalidInput, "a new resource whose value has fields; expected --type"),
        (PATH, None, ("a", "b"), InvalidInput, "expected --type"),
        ("/gcs/Test", None, ("1",), InvalidInput, "expected"),
    ],
)
async def test_foreign_or_unpublished_resource_is_refused_with_reason(
    path: str, entry: TreeEntry | None, words: tuple[str, ...], error: type[SwarmError], said: str
) -> None:
    session = Publishing(entry)
    with pytest.raises(error, match=said):
        await publish(session, path, wanted(*words), yes=True)
    assert session.written == session.resources == []
    assert session.stdout.getvalue() == ""


async def test_resource_that_running_application_writes_is_refused() -> None:
    with pytest.raises(Denied, match="another application publishes it"):
        await publish(Publishing(busy=True), PATH, wanted("1"), yes=True)


async def test_dangerous_resource_is_not_published_unconfirmed() -> None:
    session = Publishing(TreeEntry(PATH, Kind.BOARD, "Float", access="rw", confirm="it may move"))
    with pytest.raises(click.UsageError, match="publish /gcs/test/height: it may move"):
        await publish(session, PATH, wanted("1"), yes=False)
    assert session.resources == []
