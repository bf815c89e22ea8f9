"""The address (URI) of a database: its parts, and its form without the password."""

import re
from typing import Final

_PASSWORD: Final = re.compile(r"(//[^/@:]*:)(.*)@")
_PATH: Final = re.compile(r"mongodb(\+srv)?://[^/]+/(?P<database>[^?]+)")


def database_in(uri: str) -> str:
    """Database name in the address, or "" if it has none."""
    found = _PATH.match(uri)
    return found["database"] if found else ""


def password_in(uri: str) -> str:
    """Password in the address, or "" if it has none."""
    found = _PASSWORD.search(uri)
    return found[2] if found else ""


def without_password(text: str) -> str:
    """An address, or a text that contains one, with the password masked."""
    return _PASSWORD.sub(r"\1***@", text)
