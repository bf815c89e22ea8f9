"""What commands print, and where."""

import io
import json

import msgspec
import pytest
import yaml

from swarmctl.commandline.settings import CliSettings
from swarmctl.terminal.node_output import NodeOutput, print_results
from swarmctl.terminal.output import SCHEMA_VERSION, Output
from swarmctl.terminal.table import Column


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Link(msgspec.Struct, frozen=True):
    to: str
    loss_ratio: float


COLUMNS = (Column("node"), Column("loss", right=True))
ROWS = (("uav1", 0.01), ("a_very_long_name_that_no_terminal_shows_whole_" + "x" * 80, 12))


def test_table_outside_terminal_is_plain_and_uncut() -> None:
    out = io.StringIO()
    Output(CliSettings(), out).table(COLUMNS, ROWS)
    lines = out.getvalue().splitlines()
    assert len(lines) == 3
    assert lines[1].split() == ["uav1", "0.01"]
    assert lines[2].split() == [ROWS[1][0], "12"]
    assert "\x1b" not in out.getvalue()


def test_a_terminal_gets_colours_unless_they_are_forbidden(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    out = Terminal()
    Output(CliSettings(), out).table(COLUMNS, ROWS)
    assert "\x1b[" in out.getvalue()
    for settings, name in ((CliSettings(no_color=True), ""), (CliSettings(), "NO_COLOR")):
        if name:
            monkeypatch.setenv(name, "1")
        out = Terminal()
        Output(settings, out).table(COLUMNS, ROWS)
        assert "\x1b" not in out.getvalue()


def test_a_cell_is_never_taken_for_markup(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    out = Terminal()
    Output(CliSettings(), out).table((Column("text"),), (("[red]x[/red] [/nothing]",),))
    assert "[red]x[/red] [/nothing]" in out.getvalue()


class Links(msgspec.Struct, frozen=True):
    links: list[Link]


class Stamped(msgspec.Struct, frozen=True):
    stamp_ns: int
    count: int
    boot_id: int


JSON = CliSettings(output="json")
JSONL = CliSettings(output="jsonl")
YAML = CliSettings(output="yaml")
DOCUMENT = {"schema_version": SCHEMA_VERSION, "links": [{"to": "uav2", "loss_ratio": 0.5}]}


def test_a_document_carries_its_schema_version_first() -> None:
    out = io.StringIO()
    Output(JSON, out).document(Links([Link("uav2", 0.5)]))
    assert json.loads(out.getvalue()) == DOCUMENT
    assert next(iter(json.loads(out.getvalue()))) == "schema_version"


def test_document_as_yaml_is_same_as_json() -> None:
    out = io.StringIO()
    Output(YAML, out).document(Links([Link("uav2", 0.5)]))
    assert yaml.safe_load(out.getvalue()) == DOCUMENT


def test_json_list_has_one_document_per_item() -> None:
    out = io.StringIO()
    Output(JSONL, out).document(Links([Link("a", 0), Link("b", 1)]))
    found = [json.loads(line) for line in out.getvalue().splitlines()]
    assert [(one["to"], one["schema_version"]) for one in found] == [
        ("a", SCHEMA_VERSION),
        ("b", SCHEMA_VERSION),
    ]
    out = io.StringIO()
    Output(JSONL, out).document(Stamped(1, 2, 3))
    assert len(out.getvalue().splitlines()) == 1
    out = io.StringIO()
    Output(JSONL, out).document(Links([]))
    assert out.getvalue() == ""


@pytest.mark.parametrize("settings", [JSON, JSONL])
def test_continuous_items_are_lines_with_schema_version(settings: CliSettings) -> None:
    out = io.StringIO()
    printer = Output(settings, out)
    printer.line(Link("a", 0))
    printer.line(Link("b", 1))
    found = [json.loads(line) for line in out.getvalue().splitlines()]
    assert [one["to"] for one in found] == ["a", "b"]
    assert {one["schema_version"] for one in found} == {SCHEMA_VERSION}


def test_items_of_continuous_result_are_documents_of_yaml() -> None:
    out = io.StringIO()
    printer = Output(YAML, out)
    printer.line(Link("a", 0))
    printer.line(Link("b", 1))
    assert [one["to"] for one in yaml.safe_load_all(out.getvalue())] == ["a", "b"]


def test_integers_that_a_double_cannot_hold_are_text() -> None:
    out = io.StringIO()
    Output(JSON, out).document(Stamped(12, 2**53, 7))
    assert json.loads(out.getvalue())["stamp_ns"] == "12", "its type does not depend on its value"
    assert json.loads(out.getvalue())["boot_id"] == "7"
    assert json.loads(out.getvalue())["count"] == 2**53
    out = io.StringIO()
    Output(JSON, out).document(Stamped(0, 2**53 + 1, 0))
    assert json.loads(out.getvalue())["count"] == str(2**53 + 1)


def test_stderr_beside_structured_result_is_json() -> None:
    err = io.StringIO()
    printer = Output(JSON, io.StringIO(), err)
    printer.say("starting")
    printer.warn("slow")
    assert [json.loads(line) for line in err.getvalue().splitlines()] == [
        {"schema_version": SCHEMA_VERSION, "message": "starting"},
        {"schema_version": SCHEMA_VERSION, "warning": "slow"},
    ]


def test_wide_columns_are_shown_with_wide_only() -> None:
    columns = (Column("node"), Column("address", wide=True), Column("loss"))
    for output, words in (("table", ["node", "loss"]), ("wide", ["node", "address", "loss"])):
        out = io.StringIO()
        Output(CliSettings(output=output), out).table(columns, [("a", "b", "c")])
        assert out.getvalue().split("\n")[0].split() == words


def test_quiet_silences_talk_but_not_warnings() -> None:
    out, err = io.StringIO(), io.StringIO()
    loud, quiet = Output(CliSettings(), out, err), Output(CliSettings(quiet=True), out, err)
    loud.say("a")
    loud.detail("hidden")
    Output(CliSettings(verbose=True), out, err).detail("b")
    quiet.say("hidden")
    quiet.warn("c")
    assert err.getvalue() == "a\nb\nwarning: c\n"
    assert out.getvalue() == ""


def test_table_too_wide_reports_hidden_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "24")
    columns = (Column("NODE"), Column("ADDRESS", drop=1))
    rows = (("uav1", "127.0.0.1:55777:multicast"),)
    out, err = Terminal(), io.StringIO()
    Output(CliSettings(no_color=True), out, err).table(columns, rows)
    assert out.getvalue().splitlines() == ["NODE", "uav1"]
    assert err.getvalue() == "-o wide also shows ADDRESS\n"
    out = Terminal()
    Output(CliSettings(no_color=True, output="wide"), out, err).table(columns, rows)
    assert rows[0][1] in out.getvalue()


def test_table_without_rows_is_one_line_on_stderr() -> None:
    out, err = io.StringIO(), io.StringIO()
    Output(CliSettings(), out, err).table(COLUMNS, (), "title", empty="uav1: no neighbours")
    Output(CliSettings(), out, err).table(COLUMNS, ())
    assert out.getvalue() == ""
    assert err.getvalue().splitlines() == ["uav1: no neighbours", "nothing to list"]


def test_nodes_without_rows_are_named_beside_table() -> None:
    out, err = io.StringIO(), io.StringIO()
    shown = Output(CliSettings(), out, err)
    outputs = {name: NodeOutput(name, shown) for name in ("uav1", "uav2")}
    outputs["uav1"].table(COLUMNS, ROWS[:1], empty="no neighbours")
    outputs["uav2"].table(COLUMNS, (), empty="no neighbours")
    print_results(shown, outputs, {})
    assert [line.split() for line in out.getvalue().splitlines()] == [
        ["NODE", "node", "loss"],
        ["uav1", "uav1", "0.01"],
    ]
    assert err.getvalue() == "uav2: no neighbours\n"
