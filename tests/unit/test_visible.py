"""Control characters of texts from outside: shown to people as escape sequences, escaped in JSON and YAML."""

import json
import unicodedata
from typing import Any

import msgspec
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from swarmware.model.visible import HIDDEN, json_escaped, visible, visible_lines


@pytest.mark.parametrize(
    "text, expected",
    [
        ("plain text, ° é 中 😀", "plain text, ° é 中 😀"),
        ("a\x1b]0;X\x07b", "a\\x1b]0;X\\x07b"),
        ("\x9b31m", "\\x9b31m"),
        ("\x7f\x00", "\\x7f\\x00"),
        ("a\r\nb\tc", "a\\r\\nb\\tc"),
        ("a\u202eb\u2066c\u2069", "a\\u202eb\\u2066c\\u2069"),
        ("\u200b\ufeff\u2028", "\\u200b\\ufeff\\u2028"),
        ("\U000e0041", "\\U000e0041"),
        ("\udc9f", "\\udc9f"),
        ("C:\\new", "C:\\new"),
    ],
)
def test_control_character_is_shown_as_its_escape_sequence(text: str, expected: str) -> None:
    assert visible(text) == expected
    assert visible(visible(text)) == expected, "escaped twice is escaped once"
    assert visible_lines(text) == expected.replace("\\n", "\n") or text == "C:\\new"


def test_every_control_character_of_unicode_is_hidden() -> None:
    controls = [
        char for char in map(chr, range(0x110000)) if unicodedata.category(char) in ("Cc", "Zl", "Zp", "Cs")
    ]
    orders = [
        char
        for char in map(chr, range(0x110000))
        if unicodedata.bidirectional(char)
        in ("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI", "BN")
        and unicodedata.category(char) == "Cf"
    ]
    marks = ["\u200e", "\u200f", "\u061c"]
    left = [f"U+{ord(char):04X}" for char in (*controls, *orders, *marks) if not HIDDEN.match(char)]
    # marks of a shorthand, which are visible or change nothing
    assert left == [f"U+{code:04X}" for code in (0x1BCA0, 0x1BCA1, 0x1BCA2, 0x1BCA3)]


VALUES: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(VALUES)
def test_json_and_yaml_say_same_about_controls(value: Any) -> None:
    from swarmctl.terminal.output import yaml_text

    text = json_escaped(msgspec.json.encode(value).decode())
    assert json.loads(text) == value and not HIDDEN.search(text)
    document = yaml_text({"value": value})
    assert yaml.safe_load(document) == {"value": value}
    assert not HIDDEN.search(document.replace("\n", ""))
