"""Loads a mission from a file's text: each error with line, JSON pointer and the expected value."""

from collections.abc import Iterable
from itertools import islice
from typing import Any

import msgspec

from swarmware.errors import MissionError
from swarmware.mission.binding import Binding, Unbound, substitute
from swarmware.mission.block_reader import BlockReader, nearest, number_of
from swarmware.mission.catalogue import BlockName, Catalogue, built_in
from swarmware.mission.condition import ConditionExpression
from swarmware.mission.condition_parser import parse as parse_condition
from swarmware.mission.file_keys import MISSION_KEYS
from swarmware.mission.finding import Finding, sound
from swarmware.mission.model import (
    LINK_LOSS,
    ON_FAILURE,
    PRIORITIES,
    TOLERANCE_LIMIT_S,
    Block,
    MissionDefinition,
)
from swarmware.mission.source import JsonSource, SourceError, escape
from swarmware.mission.source import parse as parse_source
from swarmware.model.names import similar
from swarmware.types.mission import ParamValue

_TOP = tuple(key.name for key in MISSION_KEYS)

MISTAKES_LIMIT = 100
"""Maximum number of reported errors; the rest of the file is not read."""


HINTS_LIMIT = 1_000
"""Maximum number of names that are searched for a similar one."""


class Reading(msgspec.Struct, frozen=True):
    """Result of reading a file."""

    mission: MissionDefinition | None
    """The mission, or None if errors prevent building the graph."""
    findings: tuple[Finding, ...]
    params: tuple[str, ...] = ()
    """Names of the declared parameters."""


def load(text: str, file: str, binding: Binding, catalogue: Catalogue | None = None) -> MissionDefinition:
    """Load a mission with the parameters of a platform.

    Raises: MissionError with all errors, one per line.
    """
    reading = read(text, file, binding, catalogue)
    if reading.mission is None or not sound(reading.findings):
        raise MissionError("\n".join(str(finding) for finding in reading.findings))
    return reading.mission


def read(text: str, file: str, binding: Binding, catalogue: Catalogue | None = None) -> Reading:
    """Read a mission as far as possible, and collect all findings."""
    try:
        source = parse_source(text, file)
    except SourceError as error:
        return Reading(None, (error.finding,))
    return _Loader(source, binding, catalogue or built_in()).reading()


class _Head(msgspec.Struct):
    priority: int = 0


def priority_of(text: str) -> int:
    """Priority in the text of a checked mission; a parameter counts as 0."""
    try:
        # the head alone: the whole mission was checked, and its sender needs nothing else of it
        return msgspec.json.decode(text, type=_Head, strict=False).priority
    except msgspec.DecodeError:
        return 0


class _EnoughMistakes(Exception):
    """The limit of errors is reached; not raised outside of this file."""


class _Loader:
    """One pass over one file; findings are collected, not raised, so that all are reported together."""

    def __init__(self, source: JsonSource, binding: Binding, catalogue: Catalogue) -> None:
        self._source = source
        self._binding = binding
        self._catalogue = catalogue
        self._findings: list[Finding] = []
        self._declared: dict[str, ParamValue] = {}

    def reading(self) -> Reading:
        try:
            return self._reading()
        # an exception, because the limit may be reached at any depth of the reading
        except _EnoughMistakes:
            message = f"{MISTAKES_LIMIT} errors: the rest was not read"
            return Reading(None, (*self._findings, self._source.finding("", "shape", message)))

    def _reading(self) -> Reading:
        top = self._source.value
        # without this shape each further check would report the same error again
        if not isinstance(top, dict) or not isinstance(top.get("mission"), dict):
            self._report("", "shape", 'expected an object {"mission": {"b0": {"type": "Start", …}, …}}')
            return Reading(None, tuple(self._findings))
        for key in top:
            if key not in _TOP:
                self._report(f"/{escape(key)}", "unknown-key", f"key {key!r}: unknown; {nearest(key, _TOP)}")
        for key in ("title", "comment", "$schema"):
            if not isinstance(top.get(key, ""), str):
                self._report(f"/{key}", "shape", f"expected a text, it is {top[key]!r}")
        # the parameters first: all other parts may refer to them
        self._declared = self._params(top.get("params", {}))
        bound = {key: self._substituted(key, value) for key, value in top.items()}
        blocks = self._blocks(bound["mission"])
        starts = [block.id for block in blocks.values() if block.type == BlockName.START]
        self._one_start_some_end(blocks, starts)
        mission = MissionDefinition(
            self._source.file,
            blocks,
            starts[0] if starts else "",
            self._on_failure(bound.get("on_failure", "land")),
            self._on_link_loss(bound.get("on_link_loss", "")),
            self._requires(bound.get("requires", [])),
            int(self._number(bound, "priority", 0, *PRIORITIES)),
            self._number(bound, "tolerance_s", 30, 0, TOLERANCE_LIMIT_S),
        )
        return Reading(mission if starts else None, tuple(self._findings), tuple(self._declared))

    def _report(self, pointer: str, rule: str, message: str) -> None:
        self._findings.append(self._source.finding(pointer, rule, message))
        if len(self._findings) == MISTAKES_LIMIT:
            raise _EnoughMistakes

    def _substituted(self, key: str, value: Any) -> Any:
        if key in {"params", "title", "comment", "$schema"}:
            return value
        if key != "mission":
            return self._bind(value, f"/{escape(key)}")
        return {block: self._bind(body, f"/mission/{escape(block)}") for block, body in value.items()}

    def _bind(self, value: Any, pointer: str) -> Any:
        try:
            return substitute(value, pointer, self._binding, self._declared)
        except Unbound as error:
            self._report(error.pointer, "unbound", str(error))
            return value

    def _params(self, raw: Any) -> dict[str, ParamValue]:
        if not isinstance(raw, dict):
            self._report("/params", "shape", "expected an object of names and default values")
            return {}
        found: dict[str, ParamValue] = {}
        for name, default in raw.items():
            pointer = f"/params/{escape(name)}"
            try:
                value = msgspec.convert(default, ParamValue)
            except msgspec.ValidationError:
                self._report(pointer, "shape", "expected a number, a text, true, false or a list of points")
                continue
            given = self._binding.params.get(name, value)
            if _sort(given) != _sort(value):
                message = f"parameter {name!r} was given {given!r}: expected {_sort(value)}, as its default"
                self._report(pointer, "param-type", message)
                given = value  # the default: later parts are then checked with a possible value
            found[name] = given
        return found

    def _blocks(self, raw: dict[str, Any]) -> dict[str, Block]:
        blocks: dict[str, Block] = {}
        for block_id, body in raw.items():
            pointer = f"/mission/{escape(block_id)}"
            if not isinstance(body, dict) or not isinstance(body.get("type"), str):
                self._report(pointer, "shape", 'expected a block {"type": "…", "next": "…"}')
                continue
            reader = BlockReader(block_id, body, pointer, self._catalogue)
            blocks[block_id] = reader.block()
            for place, rule, message in reader.remarks:
                self._report(place, rule, message)
            for place, rule, message in reader.warnings:
                finding = self._source.finding(place, rule, message)
                self._findings.append(msgspec.structs.replace(finding, severity="warning"))
        for block in blocks.values():
            for edge in block.edges:
                self._target(edge.target, edge.pointer, blocks, raw)
        return blocks

    def _target(self, target: str, pointer: str, blocks: dict[str, Block], raw: Iterable[str]) -> None:
        if target in blocks:
            if blocks[target].type == BlockName.START:
                self._report(pointer, "into-start", f"leads to {target!r}, the Start: expected another block")
        elif target not in raw:
            near = similar(target, islice(raw, HINTS_LIMIT))
            hint = f"did you mean {near[0]!r}?" if near else "expected the name of a block"
            self._report(pointer, "no-such-block", f"block {target!r} does not exist; {hint}")

    def _one_start_some_end(self, blocks: dict[str, Block], starts: list[str]) -> None:
        if not starts:
            self._report("/mission", "start", "no Start block: expected exactly one")
        for extra in starts[1:]:
            message = f"a second Start beside {starts[0]!r}: expected exactly one"
            self._report(f"/mission/{escape(extra)}", "start", message)
        if not any(block.type == BlockName.END for block in blocks.values()):
            self._report("/mission", "end", "no End block: expected at least one")

    def _on_failure(self, raw: Any) -> str:
        if raw not in ON_FAILURE:
            self._report("/on_failure", "on-failure", f"{raw!r}: expected one of {', '.join(ON_FAILURE)}")
            return "land"
        return str(raw)

    def _on_link_loss(self, raw: Any) -> str:
        if raw == "" or raw in LINK_LOSS:
            return str(raw)
        self._report("/on_link_loss", "on-link-loss", f"{raw!r}: expected one of {', '.join(LINK_LOSS)}")
        return ""

    def _number(self, top: dict[str, Any], key: str, default: float, low: float, high: float) -> float:
        value = number_of(top.get(key, default))
        whole = key == "priority"
        if isinstance(value, bool) or not isinstance(value, int if whole else int | float):
            value = low - 1  # a value of another type is refused like one out of range
        if not low <= value <= high:
            kind = "a whole number" if whole else "a number"
            self._report(f"/{key}", key, f"{top[key]!r}: expected {kind} from {low:g} to {high:g}")
            return default
        return float(value)

    def _requires(self, raw: Any) -> tuple[ConditionExpression, ...]:
        if not isinstance(raw, list) or not all(isinstance(item, str) for item in raw):
            self._report("/requires", "shape", 'expected a list of conditions, such as ["battery > 20 %"]')
            return ()
        found: list[ConditionExpression] = []
        for index, text in enumerate(raw):
            try:
                found.append(parse_condition(text))
            except MissionError as error:
                self._report(f"/requires/{index}", "condition", str(error))
        return tuple(found)


def _sort(value: ParamValue) -> str:
    if isinstance(value, bool):
        return "true or false"
    if isinstance(value, int | float):
        return "a number"
    return "a text" if isinstance(value, str) else "a list of points"
