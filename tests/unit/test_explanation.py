"""An error of a document names the key, also one in a mapping or a union, and the expected value."""

from typing import Annotated, Any, Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.model.explanation import Explanation, explain


class Inner(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part of a document."""

    size: int
    code: Annotated[str, msgspec.Meta(pattern="^[a-z]+$", description="a word")] = "a"


class Outer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A document."""

    many: tuple[Inner, ...] = ()
    named: dict[str, Inner | float] = {}
    nested: dict[str, dict[str, list[int]]] = {}
    either: Inner | None = None
    colour: Literal["red", "blue"] = "red"


def explained(raw: Any) -> Explanation:
    with pytest.raises(msgspec.ValidationError) as caught:
        msgspec.convert(raw, Outer, strict=True)
    return explain(str(caught.value), raw, Outer)


@pytest.mark.parametrize(
    ("raw", "path", "text"),
    [
        ({"mani": []}, ("mani",), "key mani: unknown; did you mean many?"),
        ({"zzz": []}, ("zzz",), "key zzz: unknown; expected one of many, named, nested, either, colour"),
        ({"many": [{"sise": 1}]}, ("many", 0, "sise"), "key many[0].sise: unknown; did you mean size?"),
        ({"many": [{}]}, ("many", 0, "size"), "key many[0].size: missing; expected an integer"),
        (
            {"named": {"a": 1.0, "b": {"size": "x"}}},
            ("named", "b", "size"),
            "key named.b.size: expected `int`, got `str` (it is 'x')",
        ),
        (
            {"named": {"a": {"size": 1, "sise": 2}}},
            ("named", "a", "sise"),
            "key named.a.sise: unknown; did you mean size?",
        ),
        (
            {"nested": {"a": {}, "b c": {"d": [1, 2], "e": [1, "x"]}}},
            ("nested", "b c", "e", 1),
            "key nested.\"b c\".e[1]: expected `int`, got `str` (it is 'x')",
        ),
        (
            {"either": {"size": 1, "code": "9"}},
            ("either", "code"),
            "key either.code: expected a word (it is '9')",
        ),
        (
            {"colour": "rad"},
            ("colour",),
            "key colour: invalid enum value 'rad'; expected one of red, blue (it is 'rad')",
        ),
        ({"either": 3}, ("either",), "key either: expected `object | null`, got `int` (it is 3)"),
    ],
)
def test_the_key_and_what_was_expected_are_named(raw: Any, path: Any, text: str) -> None:
    found = explained(raw)
    assert (found.path, found.text) == (path, text)


def test_a_long_value_is_not_repeated() -> None:
    assert "it is" not in explained({"many": [{"size": "x" * 200}]}).text


VALUE = st.recursive(
    st.sampled_from([1, "a", None, 2.5, True]),
    lambda inner: (
        st.lists(inner, max_size=2)
        | st.dictionaries(st.sampled_from(["size", "code", "a", "sise", "b c"]), inner, max_size=3)
    ),
    max_leaves=6,
)


@given(st.dictionaries(st.sampled_from(["many", "named", "nested", "either", "x"]), VALUE))
def test_any_document_is_explained(raw: dict[str, Any]) -> None:
    try:
        msgspec.convert(raw, Outer, strict=True)
    except msgspec.ValidationError as error:
        found = explain(str(error), raw, Outer)
        assert found.text
        assert "[...]" not in found.text
