"""The reader of lines finds the keys that the parser of the standard library finds, each at its line."""

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from swarmware.model.toml_lines import KeyPath, key_text, line_of, toml_lines

ROOT = Path(__file__).parents[2]
FILES = [*(ROOT / "share/swarm").rglob("*.toml"), *(ROOT / "etc").rglob("*.toml"), ROOT / "pyproject.toml"]

EVERY_FORM = '''# head
a = 1 # first
"b c" = "x = 1"
'd.e' = \'\'\'
[no.table]
x = 2
\'\'\'
f.g = """
"" \\""" = 3
"""
[h.i]
j = [
  1, # one
  [2, {k = "}", l.m = 4}],
]
"\\u00e9\\t" = 1979-05-27 07:32:00
[[n]]
o = 1
[n.p]
q = 2
[[n.r]]
s = 3
[[n]]
o = 4
[[n.r]]
s = 5
'''


def paths(value: Any, before: KeyPath = ()) -> Iterator[KeyPath]:
    items: Any = ()
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list):
        items = enumerate(value)
    for key, item in items:
        yield (*before, key)
        yield from paths(item, (*before, key))


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("a",), 2),
        (("b c",), 3),
        (("d.e",), 4),
        (("f", "g"), 8),
        (("h", "i"), 11),
        (("h", "i", "j", 0), 13),
        (("h", "i", "j", 1, 1, "l", "m"), 14),
        (("h", "i", "é\t"), 16),
        (("n", 0, "p", "q"), 20),
        (("n", 0, "r", 0, "s"), 22),
        (("n", 1, "o"), 24),
        (("n", 1, "r", 0, "s"), 26),
    ],
)
def test_each_key_has_its_line(path: KeyPath, line: int) -> None:
    assert toml_lines(EVERY_FORM)[path] == line


@pytest.mark.parametrize(
    ("text", "path", "line"),
    [
        ("# a\u2028b\nc = 'd\u2028e'\nf = 1", ("f",), 3),
        ("  [ t . u ] # note\r\n a = 1\r\n", ("t", "u", "a"), 2),
        ("a = { b = 1, c = { d = 2 } }", ("a", "c", "d"), 1),
        ("b = [\n" + "1,\n" * 2_000 + "]\nc = 1\n", ("c",), 2_003),
    ],
)
def test_a_line_ends_only_at_a_line_feed(text: str, path: KeyPath, line: int) -> None:
    assert toml_lines(text)[path] == line


@pytest.mark.parametrize("text", [EVERY_FORM, *(path.read_text() for path in FILES)])
def test_the_keys_are_those_of_the_parser(text: str) -> None:
    assert set(toml_lines(text)) == set(paths(tomllib.loads(text)))


SCALAR = st.none().map(lambda _: True) | st.integers(-9, 9) | st.text(max_size=4) | st.floats(0, 1)
DOCUMENT = st.dictionaries(
    st.text(max_size=3),
    st.recursive(
        SCALAR,
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
        max_leaves=12,
    ),
    max_size=4,
)


@given(DOCUMENT)
def test_the_keys_of_any_document_are_found(raw: dict[str, Any]) -> None:
    text = tomli_w.dumps(raw)
    assert set(toml_lines(text)) == set(paths(tomllib.loads(text)))


@given(st.text("ab.\"'[]{}=,#\n\\ 1", max_size=40))
def test_any_text_is_read_to_an_end(text: str) -> None:
    lines = toml_lines(text)
    assert all(1 <= line <= text.count("\n") + 1 for line in lines.values())


def test_path_without_line_has_that_of_its_table() -> None:
    lines = toml_lines("[a]\nb = 1")
    assert line_of(lines, ("a", "c", 3)) == 1
    assert line_of(lines, ("z",)) == 0


def test_path_is_written_as_document_has_it() -> None:
    assert key_text(("roles", 2, "params", "a b", "c-d")) == 'roles[2].params."a b".c-d'
