"""Two paths whose numbers in frames are equal, found by a birthday search."""

from functools import cache
from itertools import count

from swarmware.model.names import data_id


@cache
def equal_numbers(type_name: str = "Float") -> tuple[str, str]:
    """Two paths with values of this type; about 80 000 names have a pair among 2³² numbers."""
    seen: dict[int, str] = {}
    for number in count():
        path = f"payload/value{number}"
        other = seen.setdefault(data_id(path, type_name), path)
        if other != path:
            return other, path
    raise AssertionError
