"""The address of a database as text: what it names, and how it may be shown."""

import re
from typing import Final

_PASSWORD: Final = re.compile(r"(//[^/@:]*:)(.*)@")
_PATH: Final = re.compile(r"mongodb(\+srv)?://[^/]+/(?P<database>[^?]+)")


def database_in(uri: str) -> str:
    """The database that an address names behind its hosts; empty when it names none."""
    found = _PATH.match(uri)
    return found["database"] if found else ""


def password_in(uri: str) -> str:
    """The password in an address; empty when it has none."""
    found = _PASSWORD.search(uri)
    return found[2] if found else ""


def without_password(text: str) -> str:
    """An address, or a text with one in it, as it may be shown."""
    return _PASSWORD.sub(r"\1***@", text)
