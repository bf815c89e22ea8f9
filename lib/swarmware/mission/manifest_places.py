"""Findings about the parameters of a manifest, with their lines in mission.toml."""

import re
from collections.abc import Iterable, Iterator
from typing import Any, Final

import msgspec

from swarmware.mission import vocabulary
from swarmware.mission.condition_parser import parse as parse_condition
from swarmware.mission.finding import Finding, Severity
from swarmware.mission.folder import Folder
from swarmware.mission.manifest import MANIFEST, ROLE_REFERENCE, RoleSpec, parameter_places
from swarmware.mission.source import JsonSource, SourceError
from swarmware.mission.source import parse as parse_source
from swarmware.model.document import LINES_LIMIT
from swarmware.model.names import similar
from swarmware.model.toml_lines import KeyPath, key_text, line_of, toml_lines

_PARAMETER: Final = re.compile(r"\$param\.([A-Za-z_][A-Za-z0-9_]*)")


class ManifestPlaces:
    """Where the manifest of a mission gives its parameters."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder
        self._lines: dict[KeyPath, int] | None = None

    def references(self) -> Iterator[Finding]:
        """Findings of parameters that mean the first platform of a role."""
        roles = {role.name: role for role in self._folder.manifest.roles}
        for _, path in parameter_places(self._folder.manifest):
            value = self._value(path)
            if not isinstance(value, str) or not value.startswith(ROLE_REFERENCE):
                continue
            name = value.removeprefix(ROLE_REFERENCE)
            role = roles.get(name)
            if role is None:
                near = similar(name, roles)
                hint = (
                    f"did you mean {ROLE_REFERENCE}{near[0]}?"
                    if near
                    else f"expected one of {', '.join(roles)}"
                )
                yield self._finding(path, "role-unknown", f"{value!r}: no such role; {hint}")
            elif not role.required:
                message = (
                    f"{value!r}: without a platform for this role it has no value; expected required = true"
                )
                yield self._finding(path, "role-optional", message, "warning")

    def reactions(self) -> Iterator[Finding]:
        """Findings of the conditions of reactions: fields and values that their resources never have."""
        for number, row in enumerate(self._folder.manifest.reaction):
            for key, text in (("when", row.when), ("possible", row.possible)):
                for problem in vocabulary.shipped().examine(parse_condition(text)) if text else ():
                    message = f"column {problem.at + 1} of {problem.message}"
                    yield self._finding(("reaction", number, key), "condition", message, problem.severity)

    def unused(self, used: Iterable[str]) -> Iterator[Finding]:
        """Findings of the parameters that no role declares."""
        known = sorted(used)
        for name, path in parameter_places(self._folder.manifest):
            if name not in known:
                near = similar(name, known)
                hint = f"did you mean {near[0]}?" if near else "expected it in some file's `params`"
                yield self._finding(path, "param-unused", f"no role declares it; {hint}")

    def with_origin(self, finding: Finding, role: RoleSpec, text: str) -> Finding:
        """The finding, at its place in the manifest when its cause is a value that the manifest gives."""
        # only values of parameters come from the manifest
        if not self._folder.manifest_text or finding.rule not in {"param-type", "param"}:
            return finding
        try:
            source = parse_source(text, finding.file)
        except SourceError:
            return finding
        if finding.rule == "param-type":
            name = finding.pointer.rpartition("/")[2]
        else:
            found = _PARAMETER.fullmatch(_text_at(source, finding.pointer))
            name = found[1] if found else ""
        path = self._origin(name, role)
        if path is None:
            return finding
        place = f"{finding.file}:{finding.line} {finding.pointer}"
        return self._finding(path, finding.rule, f"{finding.message} (used at {place})")

    def _origin(self, name: str, role: RoleSpec) -> KeyPath | None:
        """Where the manifest gives the value of this parameter to a role."""
        manifest = self._folder.manifest
        if name in role.params:
            return ("roles", manifest.roles.index(role), "params", name)
        return ("params", name) if name in manifest.params else None

    def _value(self, path: KeyPath) -> Any:
        value: Any = self._folder.manifest
        for part in path:
            value = getattr(value, str(part)) if isinstance(value, msgspec.Struct) else value[part]
        return value

    def _finding(self, path: KeyPath, rule: str, message: str, severity: Severity = "error") -> Finding:
        if self._lines is None:
            text = self._folder.manifest_text
            # the lines of a huge text are not worth the time: the finding then names the key alone
            self._lines = toml_lines(text) if len(text) <= LINES_LIMIT else {}
        line = line_of(self._lines, path)
        file = self._folder.place(MANIFEST)
        return Finding(file, line, "", severity, rule, f"key {key_text(path)}: {message}")


def _text_at(source: JsonSource, pointer: str) -> str:
    """The text at a JSON pointer, or "" if the value is not a text."""
    value = source.value
    for part in pointer.split("/")[1:]:
        key = part.replace("~1", "/").replace("~0", "~")
        if isinstance(value, dict):
            value = value.get(key)
        elif isinstance(value, list) and key.isdigit() and int(key) < len(value):
            value = value[int(key)]
        else:
            return ""
    return value if isinstance(value, str) else ""
