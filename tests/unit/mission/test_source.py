"""Strict JSON with places: what is refused, and whether the line is right."""

import contextlib
import json
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.mission.source import SourceError, parse

GOOD = '{\n "a": [1,\n  {"b/c": "x\\"y"}],\n "d": {"e": null}\n}'


def test_every_value_has_its_line() -> None:
    source = parse(GOOD, "m.json")
    lines = [source.line(p) for p in ("", "/a", "/a/0", "/a/1", "/a/1/b~1c", "/d/e")]
    assert lines == [1, 2, 2, 3, 3, 4]


def test_missing_place_has_line_of_its_parent() -> None:
    assert parse(GOOD, "m.json").line("/d/e/f/g") == 4


@pytest.mark.parametrize(
    ("text", "line", "pointer", "word"),
    [
        ('{\n"a": 1,\n"b": {"c": 1,\n "c": 2}}', 4, "/b/c", "twice"),
        ('{"a":\n NaN}', 2, "/a", "NaN"),
        ('{"a": [1,\n -Infinity]}', 2, "/a/1", "-Infinity"),
        ('{"a": 1}\n x', 2, "", "invalid JSON"),
        ('{"a": 1,}', 1, "", "invalid JSON"),
        ('{"a": "\\ud800"}', 0, "", "surrogate"),
        ('{"a": Infinity,\n "b\x01": 1}', 1, "/a", "Infinity"),
        ('{"a": NaN, "b": "\\x", "c": "\\u12"}', 1, "/a", "NaN"),
        ('[{"a": 1, "a": 2}, "b\x02", "\\q"', 1, "/0/a", "twice"),
        ('{"\\ud800": NaN}', 1, "/\\ud800", "NaN"),
        ('{"\\ud800": 1, "\\ud800": 2}', 1, "/\\ud800", "twice"),
        ("[" * 40 + "]" * 40, 0, "", "nested"),
        ("[" * 200_000, 0, "", "nested"),
        ("1" * 5000, 0, "", "invalid JSON"),
        (" " * (1 << 21), 0, "", "at most"),
    ],
)
def test_invalid_json_is_refused_with_place(text: str, line: int, pointer: str, word: str) -> None:
    with pytest.raises(SourceError) as caught:
        parse(text, "m.json")
    finding = caught.value.finding
    assert (finding.line, finding.pointer) == (line, pointer)
    assert word in finding.message


PIECES = st.sampled_from(
    [
        "Infinity",
        "-Infinity",
        "NaN",
        '"a": 1',
        '"a"',
        "\x01",
        '"\x02"',
        '"\\x"',
        '"\\u12"',
        '"\\ud800"',
        "{",
        "}",
        "[",
        "]",
        ",",
        ":",
        "1e400",
        "-",
        "1" * 5000,
        "\n",
        '"',
        "\\",
    ]
)


@given(
    st.lists(PIECES, max_size=12).map("".join)
    | st.lists(PIECES, max_size=8).map(lambda p: "{" + ", ".join(p))
)
def test_bad_json_gives_error_with_line(text: str) -> None:
    try:
        parse(text, "m.json")
    except SourceError as error:
        assert 0 <= error.finding.line <= text.count("\n") + 1
        assert msgspec.msgpack.encode(error.finding)


@given(st.text())
def test_any_text_is_json_or_our_error(text: str) -> None:
    with contextlib.suppress(SourceError):
        parse(text, "m.json")


JSON: st.SearchStrategy[Any] = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**40), 2**40)
    | st.text(st.characters(codec="utf-8"), max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=12,
)


@given(JSON, st.sampled_from([None, 2]))
def test_json_is_read_like_standard_library(value: Any, indent: int | None) -> None:
    try:
        text = json.dumps(value, indent=indent)
        text.encode().decode()
        source = parse(text, "m.json")
    except SourceError as error:
        assert "surrogate" in str(error)
        return
    assert source.value == json.loads(text)
    assert source.line("") == 1
