"""Parser of the validation errors of msgspec: path of the value, unknown key, message."""

import re

import msgspec

_PLACE = re.compile(r" - at `\$\.?(?P<key>[^`]*)`$")
_UNKNOWN = re.compile(r"Object contains unknown field `(?P<key>[^`]+)`")


class ValidationMessage(msgspec.Struct, frozen=True):
    """Parts of the message of one ValidationError of msgspec."""

    place: str
    """Path of the value, such as `a.b[0]`, or "" for the whole document."""
    unknown: str
    """Unknown key of the Struct at this path, or "" for another error."""
    text: str
    """The message without the path."""


def parse_validation_message(message: str) -> ValidationMessage:
    """Parses the text of a ValidationError."""
    place = _PLACE.search(message)
    unknown = _UNKNOWN.search(message)
    return ValidationMessage(
        place["key"] if place else "",
        unknown["key"] if unknown else "",
        message[: place.start()] if place else message,
    )
