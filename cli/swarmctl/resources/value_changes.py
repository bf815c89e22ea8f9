"""Several values of a file, all checked before the first is set, and all set or none."""

from collections.abc import Iterable, Mapping
from typing import Any, Final, NamedTuple

import msgspec

from swarmctl.resources.access import WriteResult, write
from swarmctl.resources.values import brief
from swarmctl.session.session import Session
from swarmware.errors import InvalidInput, Partial, SwarmError
from swarmware.types.tree import TreeEntry
from swarmware.types.units import unit_suffix

PYTHON_TYPES: Final[Mapping[str, tuple[type, ...]]] = {
    "Float": (int, float),
    "Int": (int,),
    "Bool": (bool,),
    "Text": (str,),
}
"""Types of a value in a file, by the type of the setting."""


class ValueChange(NamedTuple):
    """A resource with another value before and after."""

    path: str
    before: Any
    after: Any
    name: str
    """Name of the resource in messages."""


def check(file: str, key: str, entry: TreeEntry, value: Any) -> None:
    """Checks a value of a file before any is set; its owner checks it again.

    Raises: InvalidInput naming file, key and the expected value.
    """
    types = PYTHON_TYPES.get(entry.type)
    # a bool is an int in Python, but not a number in a file
    if types is not None and (not isinstance(value, types) or isinstance(value, bool) != (bool in types)):
        raise InvalidInput(f"{file}: {key}: {value!r}; expected a value of type {entry.type}")
    if entry.range is not None and not entry.range[0] <= value <= entry.range[1]:
        low, high = entry.range
        unit = unit_suffix(entry.unit)
        raise InvalidInput(f"{file}: {key}: {brief(value)}; expected {low:g} to {high:g}{unit}")
    if entry.choices and value not in entry.choices:
        raise InvalidInput(f"{file}: {key}: {value!r}; expected one of {', '.join(entry.choices)}")


async def set_all(session: Session, changes: Iterable[ValueChange]) -> None:
    """Sets all values; a refusal undoes the changes before it, and is raised.

    Raises: Partial when some changes could not be undone.
    """
    done: list[ValueChange] = []
    for change in changes:
        try:
            written = await _set(session, change.path, change.after)
            # before the check of its application: an unconfirmed value is stored, so it must be undone as
            # well
            done.append(change)
            written.check_applied()
        except SwarmError as error:
            left = []
            # backwards, so that a path that is named twice ends with its first value
            for earlier in reversed(done):
                try:
                    await _set(session, earlier.path, earlier.before)
                except SwarmError:
                    left.append(earlier.name)
            if left:
                raise Partial(f"{error}; not taken back: {', '.join(left)}") from error
            raise


async def _set(session: Session, path: str, value: Any) -> WriteResult:
    return await write(session, path, msgspec.json.encode(value).decode())
