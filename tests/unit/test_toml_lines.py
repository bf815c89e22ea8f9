"""The line of each key of a TOML file, whatever the form in which it is written."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.model.toml_lines import STATEMENT_LIMIT, key_lines

ETC = Path(__file__).parents[2] / "etc/swarm"


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("a = 1\n\n# b = 2\nb = 3\n", {"a": 1, "b": 4}),
        ("[t]\na = 1\n[t.u]\nb = 2", {"t.a": 2, "t.u.b": 4}),
        ('t.u.a = 1\n"b c" = 2', {"t": 1, "t.u": 1, "t.u.a": 1, "b c": 2}),
        ('a = """\nb = 1\n[c]\n"""\nd = 1', {"a": 1, "d": 5}),
        ("a = [\n  1,\n  2,\n]\nb = 1", {"a": 1, "b": 5}),
        ("a = { b = 1, c = { d = 2 } }", {"a": 1, "a.b": 1, "a.c": 1, "a.c.d": 1}),
        ("[[r]]\np = 1\n[[r]]\np = 2\n", {"r": 1, "r.p": 2}),
        ("  [ t . u ] # note\r\n a = 1\r\n", {"t.u.a": 2}),
        ("# a\u2028b\nc = 'd\u2028e'\nf = 1", {"c": 2, "f": 3}),
        ("", {}),
    ],
)
def test_each_key_has_the_line_on_which_it_begins(text: str, lines: dict[str, int]) -> None:
    assert key_lines(text) == lines


def test_a_statement_of_very_many_lines_ends_the_search() -> None:
    text = "a = 1\nb = [\n" + "1,\n" * (STATEMENT_LIMIT + 5) + "]\nc = 1\n"
    assert key_lines(text) == {"a": 1}


@pytest.mark.parametrize("path", sorted(ETC.rglob("*.toml")), ids=lambda path: path.name)
def test_the_line_of_a_shipped_key_has_its_name(path: Path) -> None:
    text = path.read_text()
    found = key_lines(text)
    assert {key.partition(".")[0] for key in found} >= {
        name for name, value in tomllib.loads(text).items() if not isinstance(value, dict)
    }
    for key, line in found.items():
        assert key.rpartition(".")[2] in text.splitlines()[line - 1]


@given(st.text(alphabet="a=1[].,\"'{}\n# ", max_size=60))
def test_any_valid_text_has_lines_within_itself(text: str) -> None:
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    assert all(1 <= line <= text.count("\n") + 1 for line in key_lines(text).values())
