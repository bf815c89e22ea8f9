"""Parses the validation errors of msgspec: path of the value, unknown key, message."""

import re

import msgspec

_PLACE = re.compile(r" - at `\$\.?(?P<key>[^`]*)`$")
_UNKNOWN = re.compile(r"Object contains unknown field `(?P<key>[^`]+)`")


class ValidationMessage(msgspec.Struct, frozen=True):
    """One error of msgspec."""

    place: str
    """Path of the value (`a.b[0]`), or "" for the whole document."""
    unknown: str
    """Unknown key of the Struct at this path, or "" for any other error."""
    text: str
    """The message without the place."""


def parse_validation_message(message: str) -> ValidationMessage:
    """Parse the text of a ValidationError."""
    place = _PLACE.search(message)
    unknown = _UNKNOWN.search(message)
    return ValidationMessage(
        place["key"] if place else "",
        unknown["key"] if unknown else "",
        message[: place.start()] if place else message,
    )
