"""The JSON Schema of mission files, made from the block catalogue: for editors and foreign tools."""

from typing import Any, Final

import msgspec

from swarmware.mission.catalogue import BlockType, Catalogue, built_in
from swarmware.mission.loader import USER_PRIORITY_LIMIT
from swarmware.mission.model import ERROR, ON_FAILURE, TIMEOUT

_BLOCK: Final = {"$ref": "#/$defs/block"}
_NUMBER_TEXT: Final = {"$ref": "#/$defs/number_text"}
_REFERENCE: Final = {"$ref": "#/$defs/reference"}
_SHARED: Final = {
    "block": {"type": "string", "description": "Name of a block."},
    "number_text": {
        "type": "string",
        "pattern": r"^[+-]?(\d{1,18}\.?\d{0,18}|\.\d{1,18})([eE][+-]?\d{1,2})?$|^\$[a-z]",
        "description": "A number as text, or $param.<name>.",
    },
    "reference": {"type": "string", "pattern": r"^\$param\.", "description": "A parameter."},
}


def mission_schema(catalogue: Catalogue | None = None) -> str:
    """The schema as JSON text (draft 2020-12)."""
    types = (catalogue or built_in()).types
    document = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Swarmware mission (BDL)",
        "description": "Made from the block catalogue; references and soundness: swarmctl mission check.",
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
            "on_failure": {"enum": list(ON_FAILURE)},
            "priority": {"type": "integer", "minimum": 0, "maximum": USER_PRIORITY_LIMIT},
            "requires": {"type": "array", "items": {"type": "string"}},
            "mission": {
                "type": "object",
                "additionalProperties": {
                    "type": "object",
                    "required": ["type"],
                    "properties": {"type": {"enum": list(types)}},
                    "allOf": [
                        {
                            "if": {"properties": {"type": {"const": name}}},
                            "then": {"$ref": f"#/$defs/{name}"},
                        }
                        for name in types
                    ],
                },
            },
        },
        "$defs": _SHARED | {name: _block(block) for name, block in types.items()},
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
    groups: list[dict[str, Any]] = []
    for name, schema in own.get("properties", {}).items():
        value = _lenient({key: part for key, part in schema.items() if key != "default"})
        for spelling in (name, *aliases.get(name, ())):
            properties[spelling] = value
        if name in own.get("required", ()):
            groups.append({"anyOf": [{"required": [word]} for word in (name, *aliases.get(name, ()))]})
    required = _successors(block, properties)
    return {
        "description": block.purpose,
        "type": "object",
        "properties": properties,
        "required": ["type", *required],
        "additionalProperties": False,
        **({"allOf": groups} if groups else {}),
    }


def _successors(block: BlockType, properties: dict[str, Any]) -> list[str]:
    """Adds the ways out; returns those that must be there."""
    match block.name:
        case "End":
            return []
        case "Fork":
            properties["next"] = {"type": "array", "items": _BLOCK, "minItems": 1, "uniqueItems": True}
            return ["next"]
        case "DecisionRandom":
            properties |= {"nextIfTrue": _BLOCK, "nextIfFalse": _BLOCK}
            return ["nextIfTrue", "nextIfFalse"]
        case "Decision":
            case = {
                "type": "object",
                "required": ["if", "next"],
                "additionalProperties": False,
                "properties": {"if": {"type": "string", "description": "A condition."}, "next": _BLOCK},
            }
            properties["cases"] = {"type": "array", "items": case, "minItems": 1}
    one = {"type": "array", "items": _BLOCK, "minItems": 1, "maxItems": 1}
    properties["next"] = {"anyOf": [_BLOCK, one]}
    others = {TIMEOUT: _BLOCK} if block.can_time_out else {}
    if block.can_time_out:
        properties |= dict.fromkeys(("timeout", "timeout_s"), _lenient({"type": "number"}))
        properties |= dict.fromkeys(("nextTimeout", "next_timeout"), _BLOCK)
    if block.errors:
        properties |= dict.fromkeys(("nextError", "next_error"), _BLOCK)
        kinds = (ERROR, *block.errors, *(f"{ERROR}:{kind}" for kind in block.errors))
        others |= dict.fromkeys(kinds, _BLOCK)
    if others:
        properties["on"] = {"type": "object", "properties": others, "additionalProperties": False}
    return ["cases", "next"] if block.name == "Decision" else ["next"]


def _lenient(schema: dict[str, Any]) -> dict[str, Any]:
    """Numbers may also be texts, anything may be a parameter: both stand in published missions."""
    for key in ("items", "prefixItems"):
        if isinstance(schema.get(key), dict):
            schema = {**schema, key: _lenient(schema[key])}
    branches = [schema, *schema.get("anyOf", ())]
    if any(branch.get("type") in {"number", "integer"} for branch in branches):
        return {"anyOf": [schema, _NUMBER_TEXT]}
    if schema.get("type") == "string":
        return schema
    return {"anyOf": [schema, _REFERENCE]}
