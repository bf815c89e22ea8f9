"""What commands print, and where."""

import io
import json

import msgspec
import pytest

from swarmctl.commandline.settings import CliSettings
from swarmctl.terminal.output import Column, Output, show


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Link(msgspec.Struct, frozen=True):
    to: str
    loss_ratio: float


COLUMNS = (Column("node"), Column("loss", right=True))
ROWS = (("uav1", 0.01), ("a_very_long_name_that_no_terminal_shows_whole_" + "x" * 80, 12))


def test_a_table_that_is_no_terminals_is_plain_and_never_cut() -> None:
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


def test_a_document_carries_its_schema_version_first() -> None:
    out = io.StringIO()
    Output(CliSettings(), out).document({"links": [Link("uav2", 0.5)]})
    assert json.loads(out.getvalue()) == {"schema_version": 1, "links": [{"to": "uav2", "loss_ratio": 0.5}]}
    assert next(iter(json.loads(out.getvalue()))) == "schema_version"


def test_lines_are_one_document_each() -> None:
    out = io.StringIO()
    printer = Output(CliSettings(), out)
    printer.line(Link("a", 0))
    printer.line(Link("b", 1))
    assert [json.loads(line)["to"] for line in out.getvalue().splitlines()] == ["a", "b"]


def test_talk_goes_to_stderr_and_quiet_silences_it_but_not_warnings() -> None:
    out, err = io.StringIO(), io.StringIO()
    loud, quiet = Output(CliSettings(), out, err), Output(CliSettings(quiet=True), out, err)
    loud.say("a")
    loud.detail("hidden")
    Output(CliSettings(verbose=True), out, err).detail("b")
    quiet.say("hidden")
    quiet.warn("c")
    assert err.getvalue() == "a\nb\nwarning: c\n"
    assert out.getvalue() == ""


@pytest.mark.parametrize(
    ("cell", "text"),
    [
        (None, "-"),
        ("", "-"),
        (True, "yes"),
        (False, "no"),
        (0, "0"),
        (0.0, "0"),
        (1.23456, "1.235"),
        (123456.7, "123457"),
    ],
)
def test_cells_are_written_for_people(cell: str | int | float | bool | None, text: str) -> None:
    assert show(cell) == text
