"""Values and their JSON Schemas in the form that viewers decode: one type a field, and no references.

Foxglove and PlotJuggler offer the fields of a schema; they know no `$ref`, `anyOf`, list of types or null.
"""

import math
from functools import lru_cache
from typing import Any, Final

from swarmware.errors import NotFound, WireError
from swarmware.recorder.payload_type import payload_class
from swarmware.types.json_form import plottable_form, plottable_schema

_OPEN: Final = {"type": "object", "properties": {}}
"""Schema of a type that is unknown here: viewers then offer the fields of its messages."""


@lru_cache(maxsize=256)
def viewer_schema(type_name: str, description: str = "") -> dict[str, Any]:
    """JSON Schema of a recorded type; fields without a single type are left out of it."""
    try:
        found = plottable_schema(payload_class(type_name, description))
    except (NotFound, WireError, TypeError):
        return _OPEN
    return _plain(found, found.get("$defs", {}), ()) or _OPEN


def _plain(node: dict[str, Any], defs: dict[str, Any], above: tuple[str, ...]) -> dict[str, Any] | None:
    """The schema without references, or None if it has no single type."""
    if "$ref" in node:
        name = node["$ref"].removeprefix("#/$defs/")
        # a type that contains itself has no schema without references
        return None if name in above else _plain(defs[name], defs, (*above, name))
    if "anyOf" in node:
        options = [_plain(one, defs, above) for one in node["anyOf"] if one != {"type": "null"}]
        return options[0] if options and all(one == options[0] for one in options) else None
    if "enum" in node:
        kinds = {type(value) for value in node["enum"]}
        return {"type": "string", **node} if kinds == {str} else None
    match node.get("type"):
        case "object":
            fields = {key: _plain(one, defs, above) for key, one in node.get("properties", {}).items()}
            return {
                "type": "object",
                **({"description": node["description"]} if "description" in node else {}),
                "properties": {key: one for key, one in fields.items() if one is not None},
            }
        case "array":
            items = [_plain(one, defs, above) for one in node.get("prefixItems", [node.get("items", {})])]
            first = items[0] if items else None
            # viewers plot arrays of one type and one dimension only
            if first is None or first["type"] == "array" or any(one != first for one in items):
                return None
            return {"type": "array", "items": first}
        case ["number", "null"]:
            return {"type": "number"}
        case str():
            return node
    return None


def viewer_value(value: Any) -> dict[str, Any]:
    """A value as JSON object without null and without numbers that JSON does not have.

    An array with such a number is left out: its other items would be at other places.
    """
    form = _finite(plottable_form(value))
    return form if isinstance(form, dict) else {} if form is None else {"value": form}


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        kept = {key: _finite(item) for key, item in value.items()}
        return {key: item for key, item in kept.items() if item is not None}
    if isinstance(value, list):
        items = [_finite(item) for item in value]
        return None if any(item is None for item in items) else items
    return value
