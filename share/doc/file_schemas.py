"""The JSON Schemas of files that people write, for editors and other tools: missions, fleets."""

from itertools import combinations
from typing import Any, Final

import msgspec

from swarmctl.membership.hosts import FleetFile
from swarmware.mission.block_reader import TIMEOUT_LIMIT_S, TIMEOUT_MIN_MS
from swarmware.mission.catalogue import BlockName, BlockType, Catalogue, Wait, built_in
from swarmware.mission.manifest import Manifest
from swarmware.mission.model import LINK_LOSS, ON_FAILURE, PRIORITIES, TOLERANCE_LIMIT_S
from swarmware.mission.outcome import OutcomeKind
from swarmware.mission.published import PUBLISHED, PublishedType

_TIMEOUT: Final = OutcomeKind.TIMEOUT.value
_ERROR: Final = OutcomeKind.ERROR.value
_BLOCK: Final = {"$ref": "#/$defs/block"}
_ONE: Final = {"anyOf": [_BLOCK, {"type": "array", "items": _BLOCK, "minItems": 1, "maxItems": 1}]}
_NUMBER_TEXT: Final = {"$ref": "#/$defs/number_text"}
_REFERENCE: Final = {"$ref": "#/$defs/reference"}
_TIMEOUT_EDGES: Final = ("nextTimeout", "next_timeout")
_ERROR_EDGES: Final = ("nextError", "next_error")
_SHARED: Final = {
    "block": {"type": "string", "description": "Name of a block."},
    "number_text": {
        "type": "string",
        "pattern": r"^[+-]?(\d{1,18}\.?\d{0,18}|\.\d{1,18})([eE][+-]?\d{1,2})?$|^\$[a-z]",
        "description": "A number as a string, or $param.<name>.",
    },
    "reference": {"type": "string", "pattern": r"^\$param\.", "description": "A parameter."},
}


def mission_schema(catalogue: Catalogue | None = None) -> str:
    """The schema as JSON text (draft 2020-12)."""
    types = (catalogue or built_in()).types
    published = {name: one for name, one in PUBLISHED.items() if one.block is not None}
    names = [*types, *published]
    document = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Swarmware mission (BDL)",
        "description": "Generated from the block catalogue; soundness: `swarmctl mission check`.",
        "type": "object",
        "required": ["mission"],
        "additionalProperties": False,
        "properties": {
            "$schema": {"type": "string"},
            "title": {"type": "string"},
            "comment": {"type": "string"},
            "params": {
                "type": "object",
                "description": "Parameters and their defaults, used as $param.<name>.",
                "additionalProperties": {"type": ["number", "string", "boolean", "array"]},
            },
            "on_failure": {"anyOf": [{"enum": list(ON_FAILURE)}, _REFERENCE]},
            "on_link_loss": {"anyOf": [{"enum": ["", *LINK_LOSS]}, _REFERENCE]},
            "requires": {"type": "array", "items": {"type": "string"}},
            "priority": _lenient({"type": "integer", "minimum": PRIORITIES[0], "maximum": PRIORITIES[1]}),
            "tolerance_s": _lenient({"type": "number", "minimum": 0, "maximum": TOLERANCE_LIMIT_S}),
            "mission": {
                "type": "object",
                "additionalProperties": {
                    "type": "object",
                    "required": ["type"],
                    "properties": {"type": {"enum": names}},
                    "allOf": [
                        {
                            "if": {"properties": {"type": {"const": name}}},
                            "then": {"$ref": f"#/$defs/{name}"},
                        }
                        for name in names
                    ],
                },
            },
        },
        "$defs": _SHARED
        | {name: _block(block) for name, block in types.items()}
        | {name: _published(one, types[str(one.block)]) for name, one in published.items()},
    }
    return msgspec.json.format(msgspec.json.encode(document), indent=1).decode() + "\n"


def _block(block: BlockType) -> dict[str, Any]:
    """Schema of one block type."""
    (top,), components = msgspec.json.schema_components((block.params,), ref_template="#/$defs/{name}")
    own = components.get(block.params.__name__, top)
    aliases: dict[str, list[str]] = {}
    for other, name in block.aliases:
        aliases.setdefault(name, []).append(other)
    properties: dict[str, Any] = {
        "type": {"const": block.name},
        "title": {"type": "string"},
        "comment": {"type": "string"},
    }
    if block.resumes:
        properties["resume"] = {"enum": list(block.resumes)}
    groups: list[dict[str, Any]] = []
    for name, schema in own.get("properties", {}).items():
        # a default in the schema would make editors insert it
        value = _lenient({key: part for key, part in schema.items() if key != "default"})
        for spelling in (name, *aliases.get(name, ())):
            properties[spelling] = value
        if name in own.get("required", ()):
            groups.append({"anyOf": [{"required": [word]} for word in (name, *aliases.get(name, ()))]})
        groups += [_at_most_one((name, *aliases[name]))] if name in aliases else []
    # the type alone cannot state that exactly one of two keys is given
    if block.params is Wait:
        groups.append({"oneOf": [{"required": ["ms"]}, {"required": ["s"]}]})
    required = _successors(block, properties, groups)
    return {
        "description": block.purpose,
        "type": "object",
        "properties": properties,
        "required": ["type", *required],
        "additionalProperties": False,
        **({"allOf": groups} if groups else {}),
    }


def _published(one: PublishedType, block: BlockType) -> dict[str, Any]:
    """Schema of a block of published BDL: its own keys in place of our parameters."""
    schema = _block(msgspec.structs.replace(block, name=one.name))
    properties = schema["properties"]
    for key, name in one.keys:
        properties[key] = {"anyOf": [properties[name], {"type": "string"}]}
        for group in schema["allOf"]:
            if {"required": [name]} in group.get("anyOf", ()):
                group["anyOf"].append({"required": [key]})
    properties |= {key: {} for key in one.ignored}
    return schema


def _at_most_one(names: tuple[str, ...]) -> dict[str, Any]:
    """The permitted spellings of one key."""
    return {"not": {"anyOf": [{"required": list(pair)} for pair in combinations(names, 2)]}}


def _successors(block: BlockType, properties: dict[str, Any], groups: list[dict[str, Any]]) -> list[str]:
    """Adds the successors of a block; returns the required ones."""
    match block.name:
        case BlockName.END:
            return []
        case BlockName.FORK:
            properties["next"] = {"type": "array", "items": _BLOCK, "minItems": 1, "uniqueItems": True}
            return ["next"]
        case BlockName.DECISION_RANDOM:
            properties |= {"nextIfTrue": _ONE, "nextIfFalse": _ONE}
            return ["nextIfTrue", "nextIfFalse"]
        case BlockName.DECISION:
            case = {
                "type": "object",
                "required": ["if", "next"],
                "additionalProperties": False,
                "properties": {"if": {"type": "string", "description": "A condition."}, "next": _BLOCK},
            }
            properties["cases"] = {"type": "array", "items": case, "minItems": 1}
    properties["next"] = _ONE
    others: dict[str, Any] = {}
    if block.can_time_out:
        _timeouts(block, properties, groups)
        others[_TIMEOUT] = _BLOCK
    if block.can_fail:
        properties |= dict.fromkeys(_ERROR_EDGES, _BLOCK)
        groups.append(_one_of_these(_ERROR_EDGES, _ERROR))
        others[_ERROR] = _BLOCK
    for kind in block.errors:
        others |= {kind: _BLOCK, f"{_ERROR}:{kind}": _BLOCK}
    if others:
        twice = [_at_most_one((kind, f"{_ERROR}:{kind}")) for kind in block.errors]
        properties["on"] = {
            "type": "object",
            "properties": others,
            "additionalProperties": False,
            **({"allOf": twice} if twice else {}),
        }
    return ["cases", "next"] if block.name == BlockName.DECISION else ["next"]


def _timeouts(block: BlockType, properties: dict[str, Any], groups: list[dict[str, Any]]) -> None:
    milliseconds = {"type": "number", "minimum": TIMEOUT_MIN_MS, "maximum": TIMEOUT_LIMIT_S * 1000}
    seconds = {"type": "number", "exclusiveMinimum": 0, "maximum": TIMEOUT_LIMIT_S}
    properties["timeout"] = {"description": "Milliseconds, as in BDL.", **_lenient(milliseconds)}
    properties["timeout_s"] = {"description": "Seconds.", **_lenient(seconds)}
    properties |= dict.fromkeys(_TIMEOUT_EDGES, _BLOCK)
    groups += [
        _at_most_one(("timeout", "timeout_s")),
        _one_of_these(_TIMEOUT_EDGES, _TIMEOUT),
    ]
    if block.timeout_s is None:
        # without a time-out this successor would never be taken
        value = {"anyOf": [{"required": ["timeout"]}, {"required": ["timeout_s"]}]}
        groups += [{"if": edge, "then": value} for edge in _spellings(_TIMEOUT_EDGES, _TIMEOUT)]


def _spellings(keys: tuple[str, ...], outcome: str) -> list[dict[str, Any]]:
    """Adds the successor for one outcome in each of its spellings."""
    nested = {"required": ["on"], "properties": {"on": {"type": "object", "required": [outcome]}}}
    return [*({"required": [key]} for key in keys), nested]


def _one_of_these(keys: tuple[str, ...], outcome: str) -> dict[str, Any]:
    """Permits at most one of the spellings of a successor."""
    pairs = combinations(_spellings(keys, outcome), 2)
    return {"not": {"anyOf": [{"allOf": list(pair)} for pair in pairs]}}


def _lenient(schema: dict[str, Any]) -> dict[str, Any]:
    """Permits strings for numbers, and a parameter for any value: published missions use both."""
    for key in ("items", "prefixItems"):
        if isinstance(schema.get(key), dict):
            schema = {**schema, key: _lenient(schema[key])}
    branches = [schema, *schema.get("anyOf", ())]
    if any(branch.get("type") in {"number", "integer"} for branch in branches):
        return {"anyOf": [schema, _NUMBER_TEXT]}
    if schema.get("type") == "string":
        return schema
    return {"anyOf": [schema, _REFERENCE]}


def manifest_schema() -> str:
    """The schema of missions of several roles as JSON text."""
    return _struct_schema(Manifest, "mission of several roles (mission.toml)", "mission check")


def hosts_schema() -> str:
    """The schema of files of hosts as JSON text."""
    return _struct_schema(FleetFile, "fleet (HOSTS.toml)", "fleet ls")


def _struct_schema(cls: type[msgspec.Struct], what: str, command: str) -> str:
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"Swarmware {what}",
        "description": f"Generated from the code that reads it; the whole check: `swarmctl {command}`.",
    } | msgspec.json.schema(cls)
    return msgspec.json.format(msgspec.json.encode(schema), indent=1).decode() + "\n"
