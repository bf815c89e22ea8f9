"""Selection of nodes: its grammar, the commands that accept it, and a command that runs at several nodes."""

import asyncio
import io
import json
import os
import re
import shlex
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import command_schemas
import jsonschema
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.patience import PATIENCE_S
from tests.unit.cli.session import ScriptedSession

from swarmctl.commandline import completion, completion_cache
from swarmctl.commandline.lazy import Command
from swarmctl.commandline.nodes import NodeSelection
from swarmctl.commandline.settings import CliSettings, Nodes
from swarmctl.main import cli
from swarmctl.main import main as swarmctl
from swarmctl.session import each_node, labs, processes, session
from swarmctl.session.each_node import at_each
from swarmctl.session.session import Session
from swarmctl.terminal.table import Column
from swarmware.errors import Denied, InvalidInput, NoAnswer, NotFound, Partial, SwarmError
from swarmware.model import names
from swarmware.model.platform_kind import PlatformKind
from swarmware.testing.client import FakeClient
from swarmware.types.tree import TreeListing

KNOWN = ("gcs", "uav1", "uav2", "uav10", "ugv1")


def leaves(group: click.Group, words: tuple[str, ...] = ()) -> Iterator[tuple[str, Command]]:
    ctx = click.Context(group)
    for name in group.list_commands(ctx):
        command = group.get_command(ctx, name)
        if isinstance(command, click.Group):
            yield from leaves(command, (*words, name))
        elif isinstance(command, Command):
            yield " ".join((*words, name)), command


LEAVES = dict(leaves(cli))


# -- grammar


@pytest.mark.parametrize(
    ("text", "chosen"),
    [
        ("uav1", ["uav1"]),
        ("uav*", ["uav1", "uav2", "uav10"]),
        ("uav{1,10}", ["uav1", "uav10"]),
        ("ugv1,uav1", ["uav1", "ugv1"]),
        ("uav{1,2},gcs", ["gcs", "uav1", "uav2"]),
        ("{uav,ugv}1,uav1", ["uav1", "ugv1"]),
        ("*", ["gcs", "uav1", "uav2", "uav10", "ugv1"]),
    ],
)
def test_selection_is_what_stands_between_braces_of_pattern(text: str, chosen: list[str]) -> None:
    selection = NodeSelection(text)
    assert selection.choose(KNOWN, "gcs") == chosen
    assert [name for name in KNOWN if selection.matches(name)] == chosen
    pattern = names.Pattern(f"/{selection.pattern}/nav/pose")
    assert [name for name in KNOWN if pattern.matches(f"/{name}/nav/pose")] == chosen


@pytest.mark.parametrize(
    "text", ["uav1,", ",", "/uav1", "uav1/nav", "uav[12]", "uav{1", "Uav1", "a b", "uav1,UAV*"]
)
def test_invalid_selection_is_refused_with_expectation(text: str) -> None:
    with pytest.raises(InvalidInput, match="expected"):
        NodeSelection(text)


@given(st.text(alphabet="uav12*{},/ U.é", max_size=12))
def test_any_text_is_a_selection_or_invalid_input(text: str) -> None:
    try:
        chosen = NodeSelection(text).choose(KNOWN, "gcs")
    except (InvalidInput, NotFound):
        return
    assert chosen == sorted(set(chosen), key=names.natural)
    assert chosen


@pytest.mark.parametrize(("text", "wrong"), [("uav1,ugv7", "ugv7"), ("uav*,usv*", "usv*"), ("b*", "b*")])
def test_each_part_of_selection_must_match_node(text: str, wrong: str) -> None:
    with pytest.raises(NotFound, match=re.escape(repr(wrong)) + ".*gcs, uav1, uav2, uav10, ugv1"):
        NodeSelection(text).choose(KNOWN, "gcs")


@pytest.mark.parametrize(
    ("words", "node"),
    [
        (["-n", "uav1", "-n", "uav2"], "uav1,uav2"),
        (["-n", "uav1,uav2"], "uav1,uav2"),
        (["--node", "uav{1,3}"], "uav{1,3}"),
        (["--all"], "*"),
        ([], ""),
    ],
)
def test_options_that_select_nodes_add_up(probe: Any, words: list[str], node: str) -> None:
    assert swarmctl(["probe", "show", *words]) == 0
    assert probe.seen.node == node
    assert swarmctl([*words, "probe", "show"]) == 0
    assert probe.seen.node == node


def test_all_goes_before_environment_and_not_beside_node(
    probe: Any,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert swarmctl(["probe", "show", "--all", "-n", "uav1"]) == 2
    assert swarmctl(["--all", "-n", "uav1", "probe", "show"]) == 2
    monkeypatch.setenv("SWARMCTL_NODE", "uav1,uav2")
    assert swarmctl(["probe", "show"]) == 0
    assert probe.seen.node == "uav1,uav2"
    for words in (["probe", "show", "--all"], ["--all", "probe", "show"]):
        assert swarmctl(words) == 0
        assert probe.seen.node == "*"
    monkeypatch.setenv("SWARMCTL_NODE", "")
    monkeypatch.setenv("SWARMCTL_ALL", "1")
    assert swarmctl(["probe", "show"]) == 0
    assert probe.seen.node == "", "an empty variable is not set, and there is none for all nodes"


def test_the_last_of_several_names_is_completed(monkeypatch: pytest.MonkeyPatch) -> None:
    found = completion_cache.CachedResource("/uav1/nav/pose", "board", "r")
    monkeypatch.setattr(completion_cache, "load", lambda: ("way", list(KNOWN), [found]))
    option = next(param for param in LEAVES["node ls"].params if param.name == "node")
    ctx = click.Context(LEAVES["node ls"])
    shown = [item.value for item in option.type.shell_complete(ctx, option, "gcs,uav1")]
    assert shown == ["gcs,uav1", "gcs,uav10"]
    ctx.obj = CliSettings(node="uav*")
    assert completion.resources({"board"})(ctx, option, "nav") == ["nav/pose"]


# -- every command

WITHOUT_NODES = {
    "completion": "prints a script",
    "docs": "opens a page",
    **dict.fromkeys(
        ("fleet ls", "fleet push", "fleet up", "fleet down", "fleet upgrade", "fleet exec"),
        "hosts of a file, selected by --host",
    ),
    "drive": "one vehicle, by one keyboard",
    "host install": "this computer",
    "host uninstall": "this computer",
    "hal calibrate": "one vehicle, named twice",
    "kill": "one vehicle, named twice",
    "lab down": "of a lab",
    "lab env": "one node, named once",
    **dict.fromkeys(
        map("keys {}".format, ("init", "invite", "join", "ls", "show", "revoke", "rotate")),
        "of the swarm's root and the node on this computer",
    ),
    "node add": "a node that is not there yet",
    "node remove": "names its nodes, which need not answer",
    "node rename": "the node on this computer",
    **dict.fromkeys(
        ("lab link", "lab cut", "lab heal", "lab partition"), "links of a lab, between two nodes"
    ),
    "lab ls": "of labs",
    "lab report": "of a folder",
    "lab run": "of a new lab",
    "lab up": "of a new lab",
    "mission check": "of files",
    "mission import": "of a file",
    "new driver": "makes a folder",
    "new block": "makes a folder",
    "new mission": "makes a folder",
    "new module": "makes a folder",
    "new service": "makes a folder",
    "tree diff": "names its two sides",
}
OF_ONE_NODE = {
    "file get": "writes one file here",
    "mission cancel": "names a run, which may have members anywhere",
    "mission prioritize": "names a run, which may have members anywhere",
    "mission start": "acts through one ground station; --member selects vehicles",
    "pub": "publishes on the joined node",
    "video rate": "a session of one node",
    "video start": "a source of one node",
    "video stop": "a session of one node",
}


def test_every_command_selects_nodes_by_pattern() -> None:
    assert {words for words, one in LEAVES.items() if one.nodes is Nodes.NONE} == set(WITHOUT_NODES)
    assert {words for words, one in LEAVES.items() if one.nodes is Nodes.ONE} == set(OF_ONE_NODE)
    for words, command in LEAVES.items():
        spellings = {name for param in command.params for name in param.opts}
        assert ("--node" in spellings) == (words not in WITHOUT_NODES), words
        assert ("--all" in spellings) == (
            words not in {*WITHOUT_NODES, *OF_ONE_NODE} or words == "lab down"
        ), words


class BoardlessClient(FakeClient):
    """A client of a ground station that no board reaches."""

    def readers(self, pattern: str, cls: type[msgspec.Struct]) -> Any:
        return {}


class FewNodes(ScriptedSession):
    """A swarm of two nodes that answers nothing but its list of resources."""

    def __init__(self, settings: CliSettings) -> None:
        super().__init__({}, BoardlessClient(kind=PlatformKind.GCS), **settings._asdict())

    async def ask(self, path: str, value: msgspec.Struct, reply: type[Any], **rest: Any) -> Any:
        if path.endswith("sys/tree/list"):
            return TreeListing(())
        raise AssertionError(f"{path} was asked before the nodes were checked")


@pytest.fixture
def few_nodes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Commands join a session of two nodes; a lab of the same nodes runs on this machine."""

    @asynccontextmanager
    async def connect(settings: CliSettings, out: Any = None) -> AsyncIterator[Session]:
        yield FewNodes(settings)

    monkeypatch.setattr(session, "connect", connect)
    monkeypatch.setattr(each_node, "connect", connect)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("SWARM_CONFIG", raising=False)
    monkeypatch.setenv("SWARMCTL_LABS", str(tmp_path / "labs"))
    here = processes.identity(os.getpid())
    nodes = [
        labs.LabNode(
            platform=name,
            kind=kind,
            folder=str(tmp_path / "labs" / "few" / name),
            shm_dir="",
            processes="one",
            offset_s=0.0,
            drift_ppm=0.0,
            pid=here.pid,
            pid_start=here.start_ticks,
        )
        for name, kind in (("gcs", PlatformKind.GCS), ("uav1", PlatformKind.UAV))
    ]
    labs.labs_folder()
    (tmp_path / "labs" / "few").mkdir()
    labs.save(
        labs.LabState(
            name="few",
            experiment="formation",
            net="loopback",
            seed=1,
            folder=str(tmp_path / "labs" / "few"),
            created_utc_ns=1,
            starter=here,
            multicast_group="",
            udp_port=1,
            nodes=tuple(nodes),
        )
    )


def typed(words: str) -> list[str]:
    """The example of a command without its nodes."""
    line = (LEAVES[words].help or "").partition("Example:")[2].strip().splitlines()[0]
    args = shlex.split(re.sub(r"(--node|-n) \S+", "", line.split(" | ")[0]))[1 + len(words.split()) :]
    local = [re.sub(r"^/[^/]+/?", "", arg) for arg in args if arg != "--all"]
    return local if words == "config diff" else [arg for arg in local if arg not in {"uav1", "uav2"}]


SELECTING = [words for words, one in LEAVES.items() if one.nodes is Nodes.SOME]


@pytest.mark.usefixtures("few_nodes")
@pytest.mark.parametrize("words", SELECTING)
def test_pattern_without_match_names_nodes_there_are(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    code = swarmctl([*words.split(), *typed(words), "-n", "zz*"])
    shown = capsys.readouterr()
    assert code == NotFound.exit_code, shown
    assert "'zz*'" in shown.err
    assert "gcs, uav1" in shown.err
    assert shown.out == ""


@pytest.mark.usefixtures("few_nodes")
@pytest.mark.parametrize("words", [*SELECTING, *OF_ONE_NODE])
def test_an_empty_selection_is_refused(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert swarmctl([*words.split(), *typed(words), "-n", ""]) == click.UsageError.exit_code
    assert "empty" in capsys.readouterr().err
    assert swarmctl([*words.split(), *typed(words), "-n", "uav1,"]) != 0


@pytest.mark.parametrize("words", OF_ONE_NODE)
def test_a_command_of_one_node_refuses_several(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert swarmctl([*words.split(), *typed(words), "-n", "uav*"]) == click.UsageError.exit_code
    assert "acts through one node" in capsys.readouterr().err


# -- one command at several nodes


class Fleet(ScriptedSession):
    """Five nodes, no requests."""

    def __init__(self, **options: Any) -> None:
        super().__init__({}, **options)

    async def platforms(self) -> list[str]:
        return list(KNOWN)


class Depth(msgspec.Struct, frozen=True):
    """Document of a command."""

    depth_m: float


def measuring(failing: Mapping[str, SwarmError]) -> Any:
    async def measure(session: Session) -> None:
        if session.platform in failing:
            raise failing[session.platform]
        session.out.warn("shallow")
        if session.settings.structured:
            session.out.document(Depth(1.5))
        else:
            session.out.table([Column("WHAT"), Column("DEPTH m", right=True)], [("keel", 1.5)])

    return measure


async def test_results_of_nodes_are_one_table_with_errors() -> None:
    fleet = Fleet(node="uav*")
    with pytest.raises(Partial, match="1 of 3 nodes failed: uav2"):
        await at_each(fleet, measuring({"uav2": NoAnswer("no route")}))
    shown = [line.split() for line in fleet.stdout.getvalue().splitlines()]
    assert shown == [
        ["NODE", "WHAT", "DEPTH", "m", "ERROR"],
        ["uav1", "keel", "1.5", "-"],
        ["uav10", "keel", "1.5", "-"],
        ["uav2", "-", "-", "no", "route"],
    ]
    assert fleet.stderr.getvalue().splitlines() == ["warning: uav1: shallow", "warning: uav10: shallow"]


async def test_results_of_several_nodes_are_one_document() -> None:
    fleet = Fleet(node="uav1,uav2", output="json")
    with pytest.raises(Partial):
        await at_each(fleet, measuring({"uav2": NoAnswer("no route")}))
    jsonschema.validate(fleet.document, command_schemas.schema("nodes"))
    assert fleet.document["nodes"] == [
        {"platform": "uav1", "result": {"depth_m": 1.5}, "error": "", "exit_code": 0},
        {"platform": "uav2", "result": None, "error": "no route", "exit_code": 4},
    ]
    lines = Fleet(node="uav1,uav2", output="jsonl")
    await at_each(lines, measuring({}))
    assert [json.loads(line)["platform"] for line in lines.stdout.getvalue().splitlines()] == ["uav1", "uav2"]


async def test_one_name_is_the_command_itself() -> None:
    fleet = Fleet(node="uav1", output="json")
    await at_each(fleet, measuring({}))
    assert fleet.document["depth_m"] == 1.5
    with pytest.raises(NoAnswer, match="no route"):
        await at_each(Fleet(node="uav2"), measuring({"uav2": NoAnswer("no route")}))


@pytest.mark.parametrize(
    ("errors", "code"),
    [
        ({}, 0),
        ({"uav1": NoAnswer("x")}, 3),
        ({"uav1": NoAnswer("x"), "uav2": NoAnswer("y")}, 4),
        ({"uav1": Denied("x"), "uav2": NoAnswer("y")}, 1),
    ],
)
async def test_exit_code_is_zero_when_all_succeeded(errors: dict[str, SwarmError], code: int) -> None:
    try:
        await at_each(Fleet(node="uav{1,2}"), measuring(errors))
    except SwarmError as error:
        assert error.exit_code == code != 0
    else:
        assert code == 0


async def test_nodes_are_commanded_at_the_same_time() -> None:
    begun: list[str] = []
    all_begun = asyncio.Event()

    async def meet(session: Session) -> None:
        begun.append(session.platform)
        if len(begun) == len(KNOWN):
            all_begun.set()
        await all_begun.wait()

    async with asyncio.timeout(PATIENCE_S):
        await at_each(Fleet(node="*"), meet)
    assert sorted(begun) == sorted(KNOWN)


# -- confirmation


class Silencing:
    """A command that asks before it acts; one node refuses before that."""

    def __init__(self) -> None:
        self.done: list[str] = []

    async def __call__(self, session: Session, *, yes: bool) -> None:
        if session.platform == "uav2":
            raise Denied("armed")
        effect = {"ugv1": "silence poses", "uav10": ""}.get(session.platform, "silence all boards")
        await session.confirm(yes, effect)
        if session.platform == session.here:
            await session.others_ended()
        self.done.append(session.platform)


@pytest.fixture
def prompts(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Questions to an operator at a terminal, who agrees."""
    asked: list[str] = []
    monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=lambda: True))

    def agree(text: str, **options: Any) -> bool:
        asked.append(text)
        return True

    monkeypatch.setattr(click, "confirm", agree)
    return asked


async def test_one_confirmation_names_all_nodes(prompts: list[str]) -> None:
    command = Silencing()
    with pytest.raises(Partial):
        await at_each(Fleet(node="*"), command, yes=False)
    assert prompts == ["gcs, uav1: silence all boards; ugv1: silence poses. Continue?"]
    assert sorted(command.done) == ["gcs", "uav1", "uav10", "ugv1"]
    assert command.done[-1] == "gcs", "the node through which the others are reached is the last"


async def test_nothing_is_done_at_any_node_without_agreement(
    prompts: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(text: str, **options: Any) -> bool:
        raise click.Abort

    command = Silencing()
    monkeypatch.setattr(click, "confirm", refuse)
    with pytest.raises(click.Abort):
        await at_each(Fleet(node="*"), command, yes=False)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    with pytest.raises(click.UsageError, match=r"gcs, uav1: silence all boards; ugv1: .*expected --yes"):
        await at_each(Fleet(node="*"), command, yes=False)
    assert command.done == []
    await at_each(Fleet(node="uav1,uav10"), command, yes=True)
    assert prompts == []


async def test_error_of_command_line_ends_all_nodes(prompts: list[str]) -> None:
    async def wrong(session: Session) -> None:
        if session.platform == "uav10":
            raise click.UsageError("--rate: expected 5hz")
        await session.confirm(False, "silence")
        raise AssertionError("acted")

    with pytest.raises(click.UsageError, match="--rate"):
        await at_each(Fleet(node="uav*"), wrong)
    assert prompts == []


def test_one_computer_of_a_platform_is_selected_alone() -> None:
    one = NodeSelection("uav1.fc")
    assert one.matches("uav1.fc")
    assert not one.matches("uav1")
    assert one.pattern == "uav1.fc"
    for text in ("uav1.fc,uav2", "uav1.Fc", "uav1.", ".fc"):
        with pytest.raises(InvalidInput):
            NodeSelection(text)
