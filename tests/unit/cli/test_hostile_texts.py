"""No control character of a value reaches the terminal or the log, in any format of any command's result."""

import datetime
import enum
import io
import json
import logging
from collections.abc import Callable
from importlib import import_module
from typing import Any

import msgspec
import pytest
import yaml
from command_schemas import DOCUMENTS

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.log.entries import show
from swarmctl.main import main as swarmctl
from swarmctl.resources.fields import block, shown_fields
from swarmctl.resources.values import brief
from swarmctl.terminal.node_output import NodeOutput, print_results
from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Column
from swarmware.errors import SwarmError
from swarmware.model.open_enum import OpenEnum
from swarmware.model.visible import HIDDEN
from swarmware.recorder.entry import LogEntry
from swarmware.service.runner import _Lines

HOSTILE = "x\x1b]0;owned\x07\x9b31m\r\nerror: forged\u202egpj.\u2066\u200b\x7f\x00"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def hostile(info: Any, above: tuple[type, ...] = ()) -> Any:
    """A value of a type, with hostile texts wherever it has texts."""
    kinds = msgspec.inspect
    match info:
        case kinds.Metadata():
            return hostile(info.type, above)
        case kinds.StructType():
            fields = {
                field.name: hostile(field.type, (*above, info.cls))
                for field in info.fields
                if field.required or info.cls not in above
            }
            # not decoded: a pattern of a field is what a result from elsewhere may not keep
            return info.cls(**fields)
        case kinds.UnionType():
            chosen = [one for one in info.types if not isinstance(one, kinds.NoneType)]
            recursive = any(isinstance(one, kinds.StructType) and one.cls in above for one in chosen)
            return None if recursive else hostile(chosen[0], above)
        case kinds.EnumType():
            return info.cls(HOSTILE) if issubclass(info.cls, OpenEnum) else next(iter(info.cls))
        case kinds.LiteralType():
            return info.values[0]
        case kinds.StrType() | kinds.AnyType():
            return HOSTILE
        case kinds.BytesType():
            return HOSTILE.encode()
        case kinds.IntType():
            return 7
        case kinds.FloatType():
            return 0.5
        case kinds.BoolType():
            return True
        case kinds.DictType():
            return {hostile(info.key_type, above): hostile(info.value_type, above)}
        case kinds.TupleType():
            return tuple(hostile(one, above) for one in info.item_types)
        case kinds.ListType() | kinds.VarTupleType() | kinds.SetType() | kinds.FrozenSetType():
            inner = info.item_type
            if isinstance(inner, kinds.StructType) and inner.cls in above:
                return []
            return [hostile(inner, above)]
    raise AssertionError(f"no value of {info}")


def result_of(command: str) -> msgspec.Struct:
    module, _, name = DOCUMENTS[command].partition(":")
    value: msgspec.Struct = hostile(msgspec.inspect.type_info(getattr(import_module(module), name)))
    return value


def clean(text: str) -> bool:
    """Whether a terminal shows the text as it is: our own line breaks alone."""
    return not HIDDEN.search(text.replace("\n", ""))


@pytest.mark.parametrize("command", DOCUMENTS)
def test_results_have_no_control_characters_in_any_format(command: str) -> None:
    value = result_of(command)
    texts = {}
    for output in ("json", "jsonl", "yaml"):
        for method in (Output.document, Output.line):
            stream = io.StringIO()
            method(Output(CliSettings(output=output), stream), value)
            texts[output, method.__name__] = stream.getvalue()
            assert clean(stream.getvalue()), (output, method.__name__)
    document = json.loads(texts["json", "document"])
    assert yaml.safe_load(texts["yaml", "document"]) == document
    assert json.loads(texts["jsonl", "line"]) == yaml.safe_load(texts["yaml", "line"])
    if repr(HOSTILE) in repr(value):
        assert repr(HOSTILE) in repr(document), "it is escaped, and nothing is lost"
    # the fields as text, as `tree get`, `call` and `log query` print them
    stream = io.StringIO()
    Output(CliSettings(), stream).text(*block(shown_fields(document), 80))
    assert clean(stream.getvalue()) and "\nerror: forged" not in stream.getvalue()


def printed(print_it: Callable[[Output], object], settings: CliSettings, stream: io.StringIO) -> str:
    err = type(stream)()
    print_it(Output(settings, stream, err))
    return stream.getvalue() + err.getvalue()


COLUMNS = (Column("NAME"), Column("WIDE", wide=True), Column("TEXT", wraps=True))


def in_nodes(out: Output) -> None:
    one, other = (NodeOutput(name, out) for name in ("uav1", "uav2"))
    one.table(COLUMNS, [(HOSTILE, HOSTILE, HOSTILE)], HOSTILE)
    one.text(HOSTILE)
    one.now(HOSTILE)
    one.say(HOSTILE)
    print_results(out, {"uav1": one, "uav2": other}, {"uav2": SwarmError(HOSTILE)})


def in_nodes_as_text(out: Output) -> None:
    one = NodeOutput("uav1", out)
    one.text(HOSTILE)
    one.document(msgspec.json.decode(b"{}"))
    print_results(out, {"uav1": one}, {})


PRINTS: dict[str, Callable[[Output], object]] = {
    "text": lambda out: out.text(HOSTILE),
    "now": lambda out: out.now(HOSTILE),
    "table": lambda out: out.table(COLUMNS, [(HOSTILE, HOSTILE, HOSTILE)], HOSTILE),
    "say": lambda out: out.say(HOSTILE),
    "warn": lambda out: out.warn(HOSTILE),
    "nodes": in_nodes,
    "nodes text": in_nodes_as_text,
    "brief": lambda out: out.text(f"{brief(HOSTILE)} {brief([HOSTILE])}"),
    "log entry": lambda out: show(
        out, LogEntry("q", 1, "uav1", "a", "event", HOSTILE, 1, 1, msgspec.msgpack.encode({HOSTILE: HOSTILE}))
    ),
}


@pytest.mark.parametrize("output", ["table", "wide", "json", "jsonl", "yaml"])
@pytest.mark.parametrize("stream", [io.StringIO, Terminal])
@pytest.mark.parametrize("name", PRINTS)
def test_text_from_outside_is_escaped_wherever_printed(
    name: str, stream: type[io.StringIO], output: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    for columns in ("80", "30"):
        monkeypatch.setenv("COLUMNS", columns)
        found = printed(PRINTS[name], CliSettings(output=output), stream())
        assert found and clean(found)
        if name in ("text", "now", "table", "brief", "log entry"):
            assert "\nerror: forged" not in found, "a value begins no line of its own"
        if name == "nodes text":
            assert "uav1: error: forged" not in found


def test_redrawn_text_has_drawing_sequences_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    stream = Terminal()
    out = Output(CliSettings(), stream)
    out.redraw(HOSTILE)
    out.redraw(HOSTILE)
    assert clean(stream.getvalue().replace("\x1b[2F\x1b[J", ""))


def test_result_for_programs_is_exact_but_on_terminal() -> None:
    for stream in (io.StringIO(), Terminal()):
        Output(CliSettings(), stream).verbatim(HOSTILE)
        assert clean(stream.getvalue()) == stream.isatty()
        assert (HOSTILE in stream.getvalue()) != stream.isatty()


ARGUMENT = HOSTILE.rstrip("\x00")


@pytest.mark.parametrize(
    "words",
    [["log", "query", "--since", ARGUMENT], ["log", "query", "--dir", ARGUMENT], ["topo", f"--{ARGUMENT}"]],
)
def test_an_error_about_an_argument_is_escaped(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    for form in ([], ["--json"]):
        assert swarmctl([*words, *form]) != 0
        assert clean(capsys.readouterr().err)


class Level(enum.Enum):
    """An enumeration that is not text."""

    LOW = 1


class Odd(msgspec.Struct):
    """Values that YAML has no type for."""

    level: Level = Level.LOW
    at: datetime.datetime = datetime.datetime(2026, 1, 2, tzinfo=datetime.UTC)
    pair: tuple[int, str] = (1, "a")
    data: bytes = b"\x00\xff"
    inner: Any = None
    wide: int = 2**60


def test_yaml_writes_special_types_like_json() -> None:
    texts = []
    for output in ("json", "yaml"):
        stream = io.StringIO()
        Output(CliSettings(output=output), stream).document(Odd(inner=[Odd()]))
        texts.append(stream.getvalue())
    assert yaml.safe_load(texts[1]) == json.loads(texts[0])
    assert json.loads(texts[0])["inner"][0]["pair"] == [1, "a"]


@pytest.mark.parametrize("journal", [False, True])
def test_log_record_cannot_begin_another_record(journal: bool) -> None:
    record = logging.LogRecord("swarm.x", logging.WARNING, "", 0, "refused: %s", (HOSTILE,), None)
    text = _Lines("uav1", journal).format(record)
    assert clean(text)
    _, *others = text.split("\n")
    assert len(others) == 1 and others[0].removeprefix("<4>").startswith("  ")
