"""What commands print on a terminal of 80 columns, of platforms, paths and texts that are long."""

import io
import re
import sys
from collections.abc import Awaitable, Callable
from typing import Any, cast

import click
import msgspec
import pytest

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.app.listing import list_applications
from swarmctl.commands.config.changes import print_history
from swarmctl.commands.config.keys import describe, print_keys
from swarmctl.commands.hal.drivers import list_drivers
from swarmctl.commands.health.report import list_faults, list_states, show_checks
from swarmctl.commands.link.neighbours import list_neighbours
from swarmctl.commands.mission.status import list_missions, print_status
from swarmctl.commands.node.identity import show_node
from swarmctl.commands.time.conversions import list_conversions
from swarmctl.commands.topo.topology import show_topology
from swarmctl.commands.traffic.counters import list_counters
from swarmctl.commands.tree.listing import draw_resources, list_resources
from swarmctl.commands.tree.reading import print_values
from swarmctl.commands.tree.types import print_type
from swarmctl.main import main
from swarmctl.membership.inviting import show_invited
from swarmctl.session.session import Session
from swarmctl.terminal.confirmation import confirm
from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Column, fitted_table
from swarmctl.terminal.wrapping import atoms, fitted_text
from swarmware.model.names import check_platform
from swarmware.testing.client import FakeClient
from swarmware.testing.virtual import VirtualClock, VirtualTime
from swarmware.transport.enrolment.inviter import Invitation
from swarmware.transport.enrolment.token import JoinToken
from swarmware.types import registry
from swarmware.types.driver import DriverTable
from swarmware.types.health import HealthState
from swarmware.types.net import Routes, RouteState
from swarmware.types.tree import Quality, TreeValue
from swarmware.types.vehicle import Pose

WIDTH = 80
PLATFORMS = [f"harbour_survey_uav{number}" for number in range(1, 13)]
FIRST = check_platform(PLATFORMS[0])
PATH = f"/{FIRST}/sensor/rangefinder_of_the_starboard_side/distance"
WORDS = "moves slowly because the distance to the leader of the formation is short"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def filled(info: Any, name: str = "", depth: int = 5) -> Any:
    """A value of a type, as long as the field of this name may be in a swarm with long names."""
    match info:
        case msgspec.inspect.Metadata():
            return filled(info.type, name, depth)
        case msgspec.inspect.StructType():
            given = {one.name: filled(one.type, one.name, depth - 1) for one in info.fields}
            return info.cls(**given)
        case msgspec.inspect.UnionType():
            kinds = [one for one in info.types if not isinstance(one, msgspec.inspect.NoneType)]
            return filled(kinds[0], name, depth)
        case msgspec.inspect.EnumType():
            return max(info.cls, key=lambda one: len(str(one.value)))
        case msgspec.inspect.LiteralType():
            return max(info.values, key=lambda one: len(str(one)))
        case msgspec.inspect.BoolType():
            return True
        case msgspec.inspect.IntType():
            return 1 if name in {"more", "kind"} else 1_234_567
        case msgspec.inspect.FloatType():
            return -12345.678
        case msgspec.inspect.BytesType():
            return msgspec.msgpack.encode([1.5] if name == "data" else 1.5)
        case msgspec.inspect.StrType():
            return text(name)
        case msgspec.inspect.VarTupleType() | msgspec.inspect.ListType():
            one = filled(info.item_type, name.removesuffix("s"), depth) if depth > 0 else None
            items = [] if one is None else [one] * 3
            return tuple(items) if isinstance(info, msgspec.inspect.VarTupleType) else items
        case msgspec.inspect.TupleType():
            return tuple(filled(one, name, depth) for one in info.item_types)
        case msgspec.inspect.DictType():
            return {}
    raise AssertionError(f"{name}: a value of {info} is missing here")


def text(name: str) -> str:
    """A text for the field of this name."""
    if name in {"platform", "via", "source", "peer", "neighbour"}:
        return FIRST
    if name in {"path", "resource"}:
        return PATH
    if name in {"type", "reply"}:
        return "Pose"
    if name in {"unit"}:
        return "m"
    if name in {"name", "check", "channel", "key"}:
        return "rangefinder_of_the_starboard_side/distance"
    return WORDS


BOARDS: dict[str, type[msgspec.Struct]] = {"health/state": HealthState, "hal/drivers": DriverTable}
"""Types of boards; of all others it is Pose."""


class LongSession(Session):
    """A session in a swarm with long names; each request is answered by a full reply of its type."""

    def __init__(self, **options: Any) -> None:
        self.stdout, self.stderr = Terminal(), Terminal()
        settings = CliSettings(**options)
        client = FakeClient(FIRST, clock=VirtualClock(VirtualTime(10**12)))
        super().__init__(client, settings, Output(settings, self.stdout, self.stderr))

    async def ask(
        self, path: str, value: Any, reply: type[Any], *, about: str = "", timeout_s: float | None = None
    ) -> Any:
        if reply is TreeValue:
            cls = BOARDS.get(value.path.partition("/")[2].partition("/")[2], Pose)
            data = registry.encode(filled(msgspec.inspect.type_info(cls)))
            return TreeValue(PATH, cls.__name__, data, 1, 1, 1, 0.25, Quality.LIVE, measured_hz=19.96)
        answer = filled(msgspec.inspect.type_info(reply))
        return msgspec.structs.replace(answer, more=0) if hasattr(answer, "more") else answer

    async def routes(self) -> Routes:
        return Routes(tuple(RouteState(name, 1, name, 256, 1, 1, 0) for name in PLATFORMS))

    async def known(self) -> tuple[str, ...]:
        return tuple(PLATFORMS)

    async def reach(self, platform: str) -> None:
        assert platform in PLATFORMS

    @property
    def printed(self) -> str:
        return self.stdout.getvalue() + self.stderr.getvalue()


COMMANDS: dict[str, Callable[[LongSession], Awaitable[Any]]] = {
    "app ls": list_applications,
    "config describe": lambda session: describe(session, ("**",)),
    "config get": lambda session: print_keys(session, "**", changed=False),
    "config history": lambda session: print_history(session, "**"),
    "hal ls": list_drivers,
    "health faults": lambda session: list_faults(session, False),
    "health info": show_checks,
    "health ls": list_states,
    "link ls": list_neighbours,
    "mission ls": list_missions,
    "mission status": print_status,
    "node info": show_node,
    "time ls": list_conversions,
    "topo": lambda session: show_topology(session, dot=False, png=""),
    "traffic ls": list_counters,
    "tree get": lambda session: print_values(session, PATH, fresh=False),
    "tree ls": lambda session: list_resources(session, "/**"),
    "tree show": lambda session: draw_resources(session, "/**"),
    "tree type": lambda session: print_type(session, "MissionState"),
}


@pytest.fixture(autouse=True)
def terminal(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    monkeypatch.setenv("COLUMNS", str(WIDTH))
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("SWARM_CONFIG", str(tmp_path))


def unbroken(printed: str, whole: str) -> None:
    """No line is too long, and each word is one of the whole text, or a part up to punctuation."""
    words = set(plain(whole).split())
    parts = {part for word in words for part in atoms(word)}
    assert max(map(len, printed.splitlines())) <= WIDTH
    for word in plain(printed).split():
        assert word in words or set(atoms(word)) <= parts, word


def plain(printed: str) -> str:
    """A text without the present time, and without commas between words."""
    return re.sub(r"[\dT:.-]+Z|,(?=\s|$)", "", printed)


@pytest.mark.parametrize("name", COMMANDS)
async def test_no_line_is_too_long_or_split(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    narrow = LongSession(node=FIRST)
    await COMMANDS[name](narrow)
    monkeypatch.setenv("COLUMNS", "2000")
    wide = LongSession(node=FIRST, output="wide")
    await COMMANDS[name](wide)
    assert narrow.stdout.getvalue().strip()
    unbroken(narrow.printed, f"{wide.printed} -o wide also shows")


@pytest.mark.parametrize(
    "words",
    [
        ["tree", "get"],
        [
            "tree",
            "get",
            PATH,
            "--config",
            "/nonexistent/folder/of/a/configuration/that/is/missing",
        ],
        ["config", "set", "navigator/altitude_kp"],
        [
            "mission",
            "check",
            f"an_unknown_mission_of_the_{FIRST}",
        ],
        ["kill", FIRST, "--confirm", "harbour_survey_uav2"],
    ],
)
def test_an_error_is_wrapped_between_words(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    shown = {}
    for width in (WIDTH, 2000):
        monkeypatch.setenv("COLUMNS", str(width))
        monkeypatch.setattr(sys, "stderr", Terminal())
        assert main(words) != 0
        shown[width] = cast("Terminal", sys.stderr).getvalue()
    assert "rror: " in shown[WIDTH]
    unbroken(shown[WIDTH], shown[2000])


def test_question_leaves_its_answer_on_same_line(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = f"{', '.join(PLATFORMS)}: restart broker: interrupted until it runs again"
    monkeypatch.setattr(sys, "stdin", Terminal("y\n"))
    monkeypatch.setattr(sys, "stderr", Terminal())
    questions: list[str] = []
    monkeypatch.setattr(click, "confirm", lambda text, **_: questions.append(text))
    confirm(False, asked)
    unbroken(
        "\n".join(f"{line} [y/N]: y" for line in questions[0].splitlines()), f"{asked}. Continue? [y/N]: y"
    )


def test_messages_are_wrapped_and_copied_text_is_not() -> None:
    stdout, stderr = Terminal(), Terminal()
    out = Output(CliSettings(), stdout, stderr)
    long = f"{PATH}: {WORDS}, {WORDS}"
    for talk in (out.say, out.warn, out.text, out.now):
        talk(long)
    unbroken(stdout.getvalue() + stderr.getvalue(), f"{long} warning:")
    out.verbatim(long)
    assert stdout.getvalue().endswith(f"{long}\n")


def test_a_text_on_a_pipe_is_not_wrapped() -> None:
    stdout = io.StringIO()
    Output(CliSettings(), stdout).text(f"{WORDS}, {WORDS}")
    assert stdout.getvalue() == f"{WORDS}, {WORDS}\n"


def test_line_with_label_continues_below_its_text() -> None:
    assert fitted_text(f"  change  {WORDS}\n  file    short", 40) == (
        "  change  moves slowly because the\n"
        "          distance to the leader of the\n"
        "          formation is short\n"
        "  file    short"
    )


def test_table_without_place_is_record_per_row() -> None:
    columns = (Column("PLATFORM"), Column("LEADER"), Column("SAYS"))
    rows = [(FIRST, "harbour_survey_uav2", "moves"), ("uav2", "-", "stays")]
    assert fitted_table(columns, rows, 50).header, "it has a place"
    assert fitted_table(columns, rows, 40).text.splitlines() == [
        "PLATFORM  harbour_survey_uav1",
        "LEADER    harbour_survey_uav2",
        "SAYS      moves",
        "",
        "PLATFORM  uav2",
        "LEADER    -",
        "SAYS      stays",
    ]


def test_invitation_line_stays_whole_on_narrow_terminal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    out = Terminal()
    token = JoinToken(bytes(16), bytes(16), 2_000_000_000, ("10.0.0.1",), 7449)
    show_invited(Output(CliSettings(), out, Terminal()), Invitation("uav1", "node", token, 0), "invited")
    assert out.getvalue() == f"swarmctl keys join {token.text()}\n"
    assert len(out.getvalue()) > 80
