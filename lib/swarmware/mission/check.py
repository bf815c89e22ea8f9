"""All checks of mission files in one call: syntax, blocks, references, soundness, ensemble."""

from collections.abc import Iterable
from functools import cached_property
from pathlib import Path

import msgspec

from swarmware.errors import ConfigError, NotFound
from swarmware.mission import flight, soundness, vocabulary
from swarmware.mission.binding import Binding
from swarmware.mission.budget import Budget
from swarmware.mission.catalogue import Catalogue, built_in
from swarmware.mission.ensemble import EnsembleRole, check_meetings, check_roles
from swarmware.mission.finding import Finding, sound
from swarmware.mission.folder import Folder, read_folder
from swarmware.mission.installed import installed
from swarmware.mission.loader import Reading, read
from swarmware.mission.manifest import MANIFEST
from swarmware.mission.manifest_places import ManifestPlaces
from swarmware.mission.model import MissionDefinition
from swarmware.mission.sensor_choice import sought
from swarmware.mission.source import JsonSource, SourceError
from swarmware.mission.source import parse as parse_source
from swarmware.model.platform_kind import PlatformKind

_GRAPH_RULES = frozenset({"edge", "no-such-block", "into-start", "start", "shape"})
"""Rules whose findings prevent the exploration of the graph."""


def check_files(paths: Iterable[Path], catalogue: Catalogue | None = None) -> list[Finding]:
    """Findings of mission files and of mission folders (those with a mission.toml), in this order.

    Without a catalogue, the built-in blocks and installed packages' blocks are known.
    Raises: NotFound when a path does not exist.
    """
    catalogue = catalogue or installed()
    findings: list[Finding] = []
    for path in paths:
        if not path.exists():
            raise NotFound(f"{path}: no such file; expected a mission in JSON, or a folder with {MANIFEST}")
        try:
            findings += check_folder(read_folder(path, catalogue), catalogue)
        except ConfigError as error:
            place = path / MANIFEST if path.is_dir() else path
            file = error.source if Path(error.source).is_file() else str(place)
            findings.append(Finding(file, error.line, "", "error", "manifest", error.message))
    return findings


def check_text(
    text: str,
    file: str,
    binding: Binding,
    catalogue: Catalogue | None = None,
    budget: Budget | None = None,
    *,
    kinds: Iterable[PlatformKind] = (),
) -> tuple[Reading, list[Finding]]:
    """Reads and checks one member's mission: the mission as read, and all findings.

    `kinds`: kinds of the platforms that may play it, or () for the binding's kind.
    """
    players = tuple(kinds) or (binding.kind,)
    reading = read(text, file, binding, catalogue or built_in())
    findings = list(reading.findings)
    mission = reading.mission
    if mission is not None:
        findings += _conditions(mission, text, file, players, binding.id)
    if mission is not None and not any(finding.rule in _GRAPH_RULES for finding in findings):
        remarks = soundness.check(mission, budget, flies=PlatformKind.UAV in players)
        if remarks:  # only findings need lines, for which the file is parsed again
            source = parse_source(text, file)
            for remark in remarks:
                pointer = mission.blocks[remark.block].pointer
                findings.append(remark.finding(file, source.line(pointer), pointer))
    return reading, findings


def _conditions(
    mission: MissionDefinition, text: str, file: str, kinds: tuple[PlatformKind, ...], own: str
) -> list[Finding]:
    """Findings of the conditions: checks their resources against the templates of the possible platforms."""
    named = mission.resources or any(sought(b.params) for b in mission.blocks.values())
    problems = vocabulary.shipped().check(mission, kinds, own) if named else []
    if not problems:
        return []
    source = parse_source(text, file)
    return [
        Finding(
            file,
            source.line(problem.pointer),
            problem.pointer,
            problem.severity,
            "condition",
            problem.message,
            column=source.column(problem.pointer, problem.text, problem.at),
        )
        for problem in problems
    ]


def check_folder(
    folder: Folder, catalogue: Catalogue | None = None, budget: Budget | None = None
) -> list[Finding]:
    """Checks the mission of a whole ensemble: each role by itself, then all together."""
    budget = budget or Budget()  # one for all roles, which limits the time of the whole check
    manifest = ManifestPlaces(folder)
    findings: list[Finding] = [*manifest.references(), *manifest.reactions()]
    roles: list[EnsembleRole] = []
    used: set[str] = set()
    for role in folder.manifest.roles:
        text = folder.texts[role.file]
        file = folder.place(role.file)
        binding = folder.example(role)
        reading, found = check_text(text, file, binding, catalogue, budget, kinds=role.kinds)
        found = [manifest.with_origin(finding, role, text) for finding in found]
        findings += found if set(role.kinds) == {PlatformKind.UAV} else map(_for_some, found)
        used.update(reading.params)
        if reading.mission is not None:
            roles.append(
                EnsembleRole(
                    role.name, role.kinds, reading.mission, role.take, _PointerLines(text, file).line
                )
            )
    findings += check_roles(roles)
    findings += manifest.unused(used)
    # a parameter of all roles has one finding, not one for each role
    findings = list(dict.fromkeys(findings))
    # an error in one role would appear again as a meeting that never takes place
    if sound(findings):
        findings += check_meetings(roles, budget)
    return findings


def _for_some(finding: Finding) -> Finding:
    """The finding as a warning: it applies only to a flying platform, and others may play the role, too."""
    return msgspec.structs.replace(finding, severity="warning") if finding.rule in flight.RULES else finding


class _PointerLines:
    """Lines of the pointers of a file, which is parsed at the first question."""

    def __init__(self, text: str, file: str) -> None:
        self._text, self._file = text, file

    @cached_property
    def _source(self) -> JsonSource | None:
        try:
            return parse_source(self._text, self._file)
        except SourceError:
            return None

    def line(self, pointer: str) -> int:
        """Line of the pointer, or 0 if the file has an error."""
        return self._source.line(pointer) if self._source else 0
