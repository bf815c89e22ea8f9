"""Strict JSON with the line of every value: duplicate keys, NaN and trailing text are refused.

`json` does not provide the positions of parsed values, and msgspec names a path but no line. A finding about
a mission names both, so the text is scanned a second time when there is a finding.
"""

import json
import re
from bisect import bisect_left
from typing import Any, Final, NoReturn

from swarmware.mission.finding import Finding

SIZE_LIMIT: Final = 1 << 20
"""Maximum characters of one mission file: a hundred times the largest known one."""
DEPTH_LIMIT: Final = 32
"""Maximum nesting of a mission file; missions are flat, so a deeper one is an error or an attack."""

_SPACE = re.compile(r"[ \t\n\r]*")
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"')
_SCALAR = re.compile(r"[^,\]}\s]+")


class SourceError(Exception):
    """The text is not JSON as missions require it; has the finding. Not raised outside of this package."""

    def __init__(self, finding: Finding) -> None:
        super().__init__(str(finding))
        self.finding = finding


class JsonSource:
    """One parsed file, with the position of each value."""

    def __init__(self, text: str, file: str, value: Any) -> None:
        self.file = file
        self.value = value
        self._json = text
        self._offsets: dict[str, int] | None = None
        self._ends: list[int] = []

    def line(self, pointer: str) -> int:
        """Line of the value, or of its nearest parent that exists."""
        offset = self._offset(pointer)
        return bisect_left(self._ends, offset) + 1

    def column(self, pointer: str, text: str, at: int) -> int:
        """Column of a character of the string at this pointer; of the string's beginning if it has
        escapes."""
        offset = self._offset(pointer)
        before = self._json.rfind("\n", 0, offset)
        same = self._json.startswith(f'"{text}"', offset)
        return offset - before + (at + 1 if same else 0)

    def _offset(self, pointer: str) -> int:
        if self._offsets is None:
            # computed only for a finding: valid missions are loaded at the speed of the C parser
            self._offsets = _Walk(self._json).offsets
            self._ends = [found.start() for found in re.finditer("\n", self._json)]
        while pointer and pointer not in self._offsets:
            pointer = pointer.rpartition("/")[0]
        return self._offsets.get(pointer, 0)

    def finding(self, pointer: str, rule: str, message: str, trace: tuple[str, ...] = ()) -> Finding:
        """An error at this place."""
        return Finding(self.file, self.line(pointer), pointer, "error", rule, message, trace)


def parse(text: str, file: str) -> JsonSource:
    """The text as JSON.

    Raises: SourceError with line and expectation.
    """
    if len(text) > SIZE_LIMIT:
        raise SourceError(_whole(file, f"{len(text)} characters: expected at most {SIZE_LIMIT}"))
    try:
        value = json.loads(text, object_pairs_hook=_unique, parse_constant=_refuse_constant)
        json.dumps(value, ensure_ascii=False).encode()
    except json.JSONDecodeError as error:
        raise SourceError(
            Finding(
                file, error.lineno, "", "error", "syntax", f"invalid JSON: {error.msg}, column {error.colno}"
            )
        ) from error
    except RecursionError as error:
        raise SourceError(_whole(file, f"nested more than {DEPTH_LIMIT} deep")) from error
    except UnicodeEncodeError as error:
        raise SourceError(_whole(file, "half of a surrogate pair: expected valid Unicode")) from error
    except _DuplicateKey as error:
        raise SourceError(_duplicate(text, file, error.key)) from error
    except _Constant as error:
        raise SourceError(_constant(text, file, error.name)) from error
    except ValueError as error:  # a number of thousands of digits
        raise SourceError(_whole(file, f"invalid JSON: {error}")) from error
    if _too_deep(value):
        raise SourceError(_whole(file, f"nested more than {DEPTH_LIMIT} deep"))
    return JsonSource(text, file, value)


def escape(key: str) -> str:
    """A key as one step of a JSON pointer."""
    return key.replace("~", "~0").replace("/", "~1")


class _DuplicateKey(Exception):
    def __init__(self, key: str) -> None:
        self.key = key


class _Constant(Exception):
    def __init__(self, name: str) -> None:
        self.name = name


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        seen: set[str] = set()
        raise _DuplicateKey(next(key for key, _ in pairs if key in seen or seen.add(key)))  # type: ignore[func-returns-value]  # set.add as "remember it"
    return found


def _refuse_constant(name: str) -> NoReturn:
    raise _Constant(name)


def _too_deep(value: Any) -> bool:
    level = [value]
    for _ in range(DEPTH_LIMIT + 1):
        level = [
            child
            for item in level
            if isinstance(item, dict | list)
            for child in (item.values() if isinstance(item, dict) else item)
        ]
        if not level:
            return False
    return True


def _whole(file: str, message: str) -> Finding:
    return Finding(file, 0, "", "error", "syntax", message)


def _line(text: str, offset: int) -> int:
    return text.count("\n", 0, offset) + 1


def _duplicate(text: str, file: str, key: str) -> Finding:
    walk = _Walk(text)
    pointer, offset = walk.duplicate or ("", 0)
    message = f"key {_printable(key)!r} occurs twice: expected once"
    return Finding(file, _line(text, offset), _printable(pointer), "error", "duplicate-key", message)


def _constant(text: str, file: str, name: str) -> Finding:
    walk = _Walk(text)
    offset = walk.constants.get(name, 0)
    message = f"{name} is not JSON: expected a finite number"
    pointer = _printable(walk.pointer_at(offset))
    return Finding(file, _line(text, offset), pointer, "error", "syntax", message)


def _printable(text: str) -> str:
    """The text with lone surrogates, which UTF-8 cannot encode, as escapes."""
    return text.encode("utf-8", "backslashreplace").decode()


class _Walk:
    """Offsets of all values of a text that the JSON parser has accepted."""

    def __init__(self, text: str) -> None:
        self._json = text
        self.offsets: dict[str, int] = {}
        self.constants: dict[str, int] = {}
        self.duplicate: tuple[str, int] | None = None
        self._value(self._skip(0), "", 0)

    def pointer_at(self, offset: int) -> str:
        return next((pointer for pointer, at in self.offsets.items() if at == offset), "")

    def _skip(self, at: int) -> int:
        found = _SPACE.match(self._json, at)
        return found.end() if found else at

    def _value(self, at: int, pointer: str, depth: int) -> int:
        self.offsets[pointer] = at
        first = self._json[at : at + 1]
        if depth > DEPTH_LIMIT or not first:
            return len(self._json)
        if first == "{":
            return self._object(at, pointer, depth)
        if first == "[":
            return self._array(at, pointer, depth)
        if first == '"':
            return self._string(at)[1]
        found = _SCALAR.match(self._json, at)
        end = found.end() if found else at + 1
        if (word := self._json[at:end]) in {"NaN", "Infinity", "-Infinity"}:
            self.constants.setdefault(word, at)
        return end

    def _string(self, at: int) -> tuple[str, int]:
        found = _STRING.match(self._json, at)
        if found is None:  # unreachable for a text that the C parser has accepted
            return "", len(self._json)
        try:
            return str(json.loads(found[0], strict=False)), found.end()
        except ValueError:  # the parser has stopped before it, so its escapes were not checked
            return found[0][1:-1], found.end()

    def _object(self, at: int, pointer: str, depth: int) -> int:
        at = self._skip(at + 1)
        seen: set[str] = set()
        while self._json[at : at + 1] == '"':
            key_at = at
            key, at = self._string(at)
            child = f"{pointer}/{escape(key)}"
            if key in seen and self.duplicate is None:
                self.duplicate = (child, key_at)
            seen.add(key)
            at = self._skip(self._value(self._skip(self._skip(at) + 1), child, depth + 1))
            if self._json[at : at + 1] != ",":
                break
            at = self._skip(at + 1)
        return at + 1

    def _array(self, at: int, pointer: str, depth: int) -> int:
        at = self._skip(at + 1)
        index = 0
        while self._json[at : at + 1] not in {"]", ""}:
            at = self._skip(self._value(at, f"{pointer}/{index}", depth + 1))
            index += 1
            if self._json[at : at + 1] != ",":
                break
            at = self._skip(at + 1)
        return at + 1
