"""Reads one block of the file: checks its parameters against its type, collects its successors."""

import math
import re
from collections.abc import Iterable
from functools import cache
from typing import Any, Final

import msgspec
import msgspec.inspect

from swarmware.errors import MissionError
from swarmware.mission.catalogue import BlockName, BlockType, Catalogue, Nothing, Params, Resume
from swarmware.mission.condition_parser import parse as parse_condition
from swarmware.mission.model import Block, Edge
from swarmware.mission.outcome import ANY_ERROR, SUCCESS, TIMED_OUT, BlockOutcome, OutcomeKind
from swarmware.mission.published import PUBLISHED, converted
from swarmware.mission.source import escape
from swarmware.model.names import similar
from swarmware.model.toml_lines import key_text
from swarmware.model.validation_message import parse_validation_message

_ALWAYS: Final = ("type", "resume", "title", "comment")
_TIMEOUT_EDGE: Final = ("nextTimeout", "next_timeout")
_ERROR_EDGE: Final = ("nextError", "next_error")
_MILLISECONDS: Final = "timeout"
"""Key of the time-out in BDL, in milliseconds."""
_SECONDS: Final = "timeout_s"
_TIMEOUT_VALUE: Final = (_MILLISECONDS, _SECONDS)
_EDGE_KEYS: Final = ("next", "on", *_TIMEOUT_EDGE, *_ERROR_EDGE, *_TIMEOUT_VALUE)
_SUCCESSORS: Final[dict[str, tuple[str, ...]]] = {
    BlockName.DECISION: ("cases",),
    BlockName.DECISION_RANDOM: ("nextIfTrue", "nextIfFalse"),
}
"""Keys for successors that single types have beside the common ones."""
_NUMBER = re.compile(r"[+-]?(\d{1,18}\.?\d{0,18}|\.\d{1,18})([eE][+-]?\d{1,2})?", re.ASCII)

KEYS: Final = frozenset({*_ALWAYS, *_EDGE_KEYS})
"""Keys that cannot be the name of a parameter."""

TIMEOUT_LIMIT_S: Final = 86_400.0
"""Longest time-out of a block: a day."""
TIMEOUT_MIN_MS: Final = 1_000.0
"""Minimum time-out in the BDL form: a smaller number was probably meant in seconds."""


def nearest(word: str, known: Iterable[str]) -> str:
    """A hint: the known word that is most similar to this one."""
    lower = {name.lower(): name for name in known}
    near = similar(word.lower(), list(lower), cutoff=0.0)
    return f"nearest known: {lower[near[0]]}" if near else "no names are known"


class BlockReader:
    """Reads one block; errors are collected in `remarks` as (pointer, rule, message)."""

    def __init__(self, block_id: str, body: dict[str, Any], pointer: str, catalogue: Catalogue) -> None:
        self.remarks: list[tuple[str, str, str]] = []
        self.warnings: list[tuple[str, str, str]] = []
        self._id = block_id
        self._body = body
        self._pointer = pointer
        self._edges: dict[BlockOutcome, Edge] = {}
        name = body["type"]
        published = PUBLISHED.get(name)
        self._published = published
        known = catalogue.find(published.block if published and published.block else name)
        if published is not None and published.block is None:
            message = f"block type {name!r} of published BDL has no counterpart: {published.instead}"
            self._report("type", "unknown-block", message)
        elif known is None:
            message = f"block type {name!r}: unknown; {nearest(name, catalogue.types)}"
            if catalogue.unusable:
                message += f"; not available: {'; '.join(catalogue.unusable)}"
            self._report("type", "unknown-block", message)
        self._known = known is not None
        # read on with a stand-in, so that the other errors of the block are reported as well
        self._spec = known or BlockType(name, "A block of an unknown type.", timeout_s=60.0)

    def block(self) -> Block:
        """The block, as far as it is valid."""
        timeout_s = self._timeout()
        self._successors()
        if TIMED_OUT in self._edges and timeout_s is None:
            place = self._edges[TIMED_OUT].pointer
            message = "a time-out successor, but no time-out: expected `timeout_s` in seconds beside it"
            self.remarks.append((place, "timeout", message))
        params = self._params()
        if timeout_s is not None and not any(key in self._body for key in _TIMEOUT_VALUE):
            timeout_s += params.lasts_s
        return Block(
            self._id,
            self._spec,
            params,
            tuple(self._edges.values()),
            timeout_s,
            self._pointer,
            self._resume(),
        )

    def _resume(self) -> Resume:
        given, allowed = self._body.get("resume", self._spec.resume), self._spec.resumes
        if "resume" in self._body and given not in allowed:
            expected = f"one of {', '.join(allowed)}" if allowed else "none: it takes no time"
            self._report("resume", "resume", f"{given!r}: expected {expected}")
            return self._spec.resume
        return given  # type: ignore[no-any-return]  # one of the allowed

    def _report(self, key: str, rule: str, message: str) -> None:
        place = f"{self._pointer}/{key}" if key else self._pointer
        self.remarks.append((place, rule, message))

    def _timeout(self) -> float | None:
        given = [key for key in _TIMEOUT_VALUE if key in self._body]
        if not given:
            return self._spec.timeout_s
        key = given[0]
        if len(given) > 1:
            self._report(given[1], "twice", f"{key!r} is a second time-out: expected one of them")
        if not self._spec.can_time_out:
            self._report(key, "timeout", f"a {self._spec.name} cannot time out: expected no `{key}`")
            return None
        value = number_of(self._body[key])
        # a truth value is an integer in Python
        if isinstance(value, bool) or not isinstance(value, int | float):
            value = -1.0
        if key == _SECONDS:
            if 0 < value <= TIMEOUT_LIMIT_S:
                return float(value)
            expected = f"seconds, above 0, at most {TIMEOUT_LIMIT_S:g}"
        else:
            if TIMEOUT_MIN_MS <= value <= TIMEOUT_LIMIT_S * 1000:
                return float(value) / 1000
            expected = (
                f"milliseconds, as in BDL, from {TIMEOUT_MIN_MS:g} to {TIMEOUT_LIMIT_S * 1000:.0f}, "
                f"or `{_SECONDS}` in seconds"
            )
        self._report(key, "timeout", f"{self._body[key]!r}: expected {expected}")
        return self._spec.timeout_s

    def _successors(self) -> None:
        for key in ("title", "comment"):
            if not isinstance(self._body.get(key, ""), str):
                self._report(key, "shape", f"expected a text, it is {self._body[key]!r}")
        match self._spec.name:
            case BlockName.END:
                for key in ("next", *_ERROR_EDGE, *_TIMEOUT_EDGE, "on"):
                    if key in self._body:
                        self._report(key, "edge", "an End has no successor")
                return
            case BlockName.FORK:
                self._fork()
            case BlockName.DECISION_RANDOM:
                self._edge(BlockOutcome(OutcomeKind.TRUE), "nextIfTrue")
                self._edge(BlockOutcome(OutcomeKind.FALSE), "nextIfFalse")
                if "next" in self._body:
                    self._report("next", "edge", "expected `nextIfTrue` and `nextIfFalse` instead of `next`")
            case name:
                if name == BlockName.DECISION:
                    self._cases()
                self._edge(SUCCESS, "next")
        for key in _TIMEOUT_EDGE:
            if key in self._body:
                self._timeout_edge(self._body[key], key)
        for key in _ERROR_EDGE:
            if key in self._body:
                self._error_edge(ANY_ERROR, self._body[key], key)
        if "on" in self._body:
            self._on(self._body["on"])

    def _fork(self) -> None:
        targets = self._body.get("next")
        if not isinstance(targets, list) or not targets or not all(isinstance(t, str) for t in targets):
            self._report("next", "edge", 'expected a list of successors, such as ["b2", "b3"]')
            return
        for index, target in enumerate(targets):
            if target in targets[:index]:
                self._report(f"next/{index}", "edge", f"{target!r} is given twice: expected each once")
            self._add(BlockOutcome(OutcomeKind.OK, branch=index), target, f"next/{index}")

    def _cases(self) -> None:
        cases = self._body.get("cases")
        if not isinstance(cases, list) or not cases:
            self._report("cases", "edge", 'expected a list [{"if": "battery < 30 %", "next": "b7"}]')
            return
        for index, case in enumerate(cases):
            place = f"cases/{index}"
            if not isinstance(case, dict) or set(case) != {"if", "next"}:
                self._report(place, "edge", 'expected {"if": "<condition>", "next": "<block>"}')
                continue
            if not isinstance(case["if"], str) or not isinstance(case["next"], str):
                self._report(place, "edge", "expected texts as condition and successor")
                continue
            try:
                condition = parse_condition(case["if"])
            except MissionError as error:
                self._report(f"{place}/if", "condition", str(error))
                continue
            pointer = f"{self._pointer}/{place}/next"
            outcome = BlockOutcome(OutcomeKind.CASE, branch=index)
            self._edges[outcome] = Edge(outcome, case["next"], pointer, condition)

    def _edge(self, outcome: BlockOutcome, key: str) -> None:
        target = self._body.get(key)
        # published missions write a single successor as a list
        if isinstance(target, list) and len(target) == 1:
            target = target[0]
        if isinstance(target, str):
            self._add(outcome, target, key)
        elif target is None:
            self._report("", "edge", f"no `{key}`: expected the block that follows")
        else:
            self._report(key, "edge", f"expected one block; only a Fork has several, it is {target!r}")

    def _timeout_edge(self, target: Any, key: str) -> None:
        if not self._spec.can_time_out:
            self._report(key, "edge", f"a {self._spec.name} cannot time out: expected no `{key}`")
        elif not isinstance(target, str):
            self._report(key, "edge", f"expected a block, it is {target!r}")
        else:
            self._add(TIMED_OUT, target, key)

    def _error_edge(self, outcome: BlockOutcome, target: Any, key: str) -> None:
        if not self._spec.can_fail:
            self._report(key, "edge", f"a {self._spec.name} cannot fail: expected no `{key}`")
        elif not isinstance(target, str):
            self._report(key, "edge", f"expected a block, it is {target!r}")
        else:
            self._add(outcome, target, key)

    def _on(self, others: Any) -> None:
        if not self._spec.can_time_out and not self._spec.can_fail:
            self._report("on", "edge", f"a {self._spec.name} ends in one way only: expected no `on`")
            return
        if not isinstance(others, dict):
            self._report("on", "edge", 'expected {"timeout": "b7", "<error kind>": "b8"}')
            return
        for word, target in others.items():
            place = f"on/{escape(word)}"
            kind = word.removeprefix(f"{OutcomeKind.ERROR}:")
            if word == OutcomeKind.TIMEOUT:
                self._timeout_edge(target, place)
            elif word == OutcomeKind.ERROR:
                self._error_edge(ANY_ERROR, target, place)
            # of an unknown type the kinds of errors are unknown, too
            elif self._known and kind not in self._spec.errors:
                timeout = (OutcomeKind.TIMEOUT,) if self._spec.can_time_out else ()
                kinds = (*timeout, OutcomeKind.ERROR, *self._spec.errors)
                message = f"a {self._spec.name} does not end with {word!r}; expected {', '.join(kinds)}"
                self._report(place, "edge", message)
            else:
                self._error_edge(BlockOutcome(OutcomeKind.ERROR, kind), target, place)

    def _add(self, outcome: BlockOutcome, target: str, key: str) -> None:
        pointer = f"{self._pointer}/{key}"
        if outcome in self._edges:
            first = self._edges[outcome].pointer.removeprefix(f"{self._pointer}/")
            self._report(
                key,
                "twice",
                f"the successor for {outcome.label!r} is given at `{first}` as well; expected one of them",
            )
            return
        self._edges[outcome] = Edge(outcome, target, pointer)

    def _params(self) -> Params:
        if not self._known:
            return Nothing()
        edge_keys = {*_ALWAYS, *_EDGE_KEYS, *_SUCCESSORS.get(self._spec.name, ())}
        aliases = dict(self._spec.aliases)
        raw: dict[str, Any] = {}
        spelled: dict[str, str] = {}
        types = _types(self._spec.params)
        own_keys = set(edge_keys)
        if self._published is not None:
            own_keys |= self._read_published(raw, spelled)
        for key, value in self._body.items():
            if key in own_keys:
                continue
            name = aliases.get(key, key)
            if name in raw:
                self._report(escape(key), "twice", f"the same as {spelled[name]!r}: expected one of them")
            # published missions write numbers as strings: "ms": "500"
            raw[name], spelled[name] = value if _is_text(value, types.get(name)) else number_of(value), key
        try:
            params = msgspec.convert(raw, self._spec.params)
            # computed here, as the class of a package may fail in it
            _ = params.lasts_s
        except msgspec.ValidationError as error:
            self._explain(str(error), raw, spelled)
            return Nothing()
        except Exception as error:  # noqa: BLE001 - the code of a package checks its parameters, and may fail
            message = f"{self._spec.name}: its parameters cannot be checked: {type(error).__name__}: {error}"
            self._report("", "param", message)
            return Nothing()
        for name, key in spelled.items():
            if not _finite(getattr(params, name)):
                self._report(escape(key), "param", f"{raw[name]!r}: expected a finite number")
        return params

    def _read_published(self, raw: dict[str, Any], spelled: dict[str, str]) -> set[str]:
        """Takes the parameters of a block of published BDL; returns the keys that are read."""
        published = self._published
        assert published is not None
        for name, (key, value) in converted(published, self._body).items():
            raw[name], spelled[name] = value, key
        for key in published.ignored:
            if key in self._body:
                message = f"{key!r} of {published.name} has no counterpart: the block is played without it"
                self.warnings.append((f"{self._pointer}/{key}", "no-counterpart", message))
        return {*(key for key, _ in published.keys), *published.ignored}

    def _explain(self, text: str, raw: dict[str, Any], spelled: dict[str, str]) -> None:
        names = [field.encode_name for field in msgspec.structs.fields(self._spec.params)]
        unknown = parse_validation_message(text)
        if unknown.unknown and not unknown.place:
            key = unknown.unknown
            hint = nearest(key, names) if names else "it has none"
            message = f"parameter {key!r} of {self._spec.name}: unknown; {hint}"
            self._report(escape(spelled.get(key, key)), "param", message)
            return
        from swarmware.model.explanation import explain  # of errors only

        found = explain(text, raw, self._spec.params)
        if not found.path:
            self._report("", "param", f"{self._spec.name}: {found.error[:1].lower()}{found.error[1:]}")
            return
        name = str(found.path[0])
        path = (spelled.get(name, name), *found.path[1:])
        # a missing parameter has no place of its own
        place = path if name in spelled else path[:-1]
        value = f", it is {self._body[spelled[name]]!r}" if name in spelled else ""
        subject = f"parameter {key_text(path)!r} of {self._spec.name}"
        self._report(
            "/".join(escape(str(part)) for part in place), "param", f"{subject}: {found.error}{value}"
        )


@cache
def _types(params: type[Params]) -> dict[str, msgspec.inspect.Type]:
    """Types of the parameters, by name."""
    fields = msgspec.inspect.type_info(params).fields  # type: ignore[attr-defined]  # a Struct's info
    return {field.encode_name: field.type for field in fields}


def _is_text(value: Any, kind: msgspec.inspect.Type | None) -> bool:
    """Whether a parameter of this type keeps this string, even when it looks like a number."""
    match kind:
        case msgspec.inspect.Metadata(type=inner):
            return _is_text(value, inner)
        case msgspec.inspect.UnionType(types=types):
            return any(_is_text(value, one) for one in types)
        case msgspec.inspect.StrType():
            return True
        case msgspec.inspect.LiteralType(values=values):
            return value in values
        case msgspec.inspect.EnumType(cls=cls):
            return any(value == one.value for one in cls)
    return False


def number_of(value: Any) -> Any:
    """The number in a string; any other value unchanged."""
    if not isinstance(value, str) or not _NUMBER.fullmatch(value):
        return value
    return int(value) if value.lstrip("+-").isdigit() else float(value)


def _finite(value: Any) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, tuple):
        return all(_finite(item) for item in value)
    return True
