"""Errors of msgspec taken apart: what this library prints depends on the form of their text."""

import msgspec
import pytest

from swarmware.model.validation_message import ValidationMessage, parse_validation_message


class Inner(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part of a document."""

    size: int = 0


class Outer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A document."""

    inner: Inner = Inner()
    many: tuple[Inner, ...] = ()


@pytest.mark.parametrize(
    ("raw", "place", "unknown"),
    [
        ({"inner": {"size": "x"}}, "inner.size", ""),
        ({"many": [{"size": "x"}]}, "many[0].size", ""),
        ({"inner": {"sise": 1}}, "inner", "sise"),
        ({"iner": 1}, "", "iner"),
        ([], "", ""),
    ],
)
def test_msgspec_error_place_and_key_are_found(raw: object, place: str, unknown: str) -> None:
    with pytest.raises(msgspec.ValidationError) as caught:
        msgspec.convert(raw, Outer)
    found = parse_validation_message(str(caught.value))
    assert (found.place, found.unknown) == (place, unknown)
    assert "`$" not in found.text


def test_text_of_another_form_stays_what_it_is() -> None:
    assert parse_validation_message("truncated") == ValidationMessage("", "", "truncated")
