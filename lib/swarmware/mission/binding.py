"""Values of the `$…` variables in a mission: the platform, and the mission's parameters."""

import re
from typing import Any, Final

import msgspec

from swarmware.mission.source import escape
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import ParamValue

_NAME = re.compile(r"\$(param\.[A-Za-z_][A-Za-z0-9_]*|[a-z_]+)")

VARIABLES: Final = ("id", "kind", "role", "mission")
"""Variables without a declaration: $id is the platform (also as $mavid, the name in published missions)."""


class Binding(msgspec.Struct, frozen=True):
    """Values for one platform's copy of a mission."""

    id: str = "uav1"
    kind: PlatformKind = PlatformKind.UAV
    role: str = "all"
    mission: str = "mission"
    params: dict[str, ParamValue] = {}

    def variable(self, name: str) -> str | None:
        """Value of a variable, or None for an unknown one."""
        if name == "mavid":
            return self.id
        return str(getattr(self, name)) if name in VARIABLES else None


class Unbound(Exception):
    """A `$name` without a value; has place and message. Not raised outside of this package."""

    def __init__(self, pointer: str, message: str) -> None:
        super().__init__(message)
        self.pointer = pointer


def substitute(value: Any, pointer: str, binding: Binding, declared: dict[str, ParamValue]) -> Any:
    """The JSON value with every `$…` replaced; a string that is only `$param.x` gets the parameter's type.

    Raises: Unbound for a name without a value.
    """
    if isinstance(value, str):
        return _text(value, pointer, binding, declared)
    if isinstance(value, list):
        return [substitute(item, f"{pointer}/{i}", binding, declared) for i, item in enumerate(value)]
    if isinstance(value, dict):
        return {
            key: substitute(item, f"{pointer}/{escape(key)}", binding, declared)
            for key, item in value.items()
        }
    return value


def _text(value: str, pointer: str, binding: Binding, declared: dict[str, ParamValue]) -> Any:
    # most texts have no variable, and need no search
    if "$" not in value:
        return value

    def resolve(name: str) -> ParamValue:
        if name.startswith("param."):
            key = name.removeprefix("param.")
            if key in declared:
                return declared[key]
            known = ", ".join(sorted(declared)) or "none is declared"
            raise Unbound(pointer, f"parameter ${name}: unknown; expected one of params ({known})")
        found = binding.variable(name)
        if found is None:
            names = ", ".join(f"${known}" for known in VARIABLES)
            raise Unbound(pointer, f"variable ${name}: unknown; expected {names} or $param.<name>")
        return found

    # a text that is only a variable becomes a value of its type, such as a number
    whole = _NAME.fullmatch(value)
    if whole:
        return resolve(whole[1])
    return _NAME.sub(lambda found: _as_text(resolve(found[1])), value)


def _as_text(value: ParamValue) -> str:
    if isinstance(value, bool):
        # as JSON writes it, not as Python does
        return "true" if value else "false"
    return str(value)
