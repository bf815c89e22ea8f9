"""Strings with a vocabulary on the wire."""

from enum import StrEnum
from typing import Self


class OpenEnum(StrEnum):
    """An enumeration whose vocabulary may grow: an unknown value is kept unchanged.

    A node of a later version may send values that this one does not know. Such a value equals no member, is
    displayed and forwarded unchanged, and does not invalidate the rest of the payload. A vocabulary that
    indexes a table is a closed Literal instead: a payload with another value is refused.
    """

    @classmethod
    def _missing_(cls, value: object) -> Self | None:
        if not isinstance(value, str):
            return None
        unknown = str.__new__(cls, value)
        unknown._name_ = unknown._value_ = value
        return unknown

    @property
    def known(self) -> bool:
        """Whether the value is one of the members."""
        return self._value_ in type(self)._value2member_map_
