"""Missions given by an operator: the name of a shipped one, a folder or a file."""

import json
from collections.abc import Iterable
from pathlib import Path

import msgspec

from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Column
from swarmware.errors import InvalidInput, MissionError, NotFound
from swarmware.mission.check import check_files
from swarmware.mission.finding import Finding, sound
from swarmware.mission.folder import read_files
from swarmware.mission.manifest import MANIFEST
from swarmware.model.config import share_dir
from swarmware.types.mission import MissionTask, ParamValue


class MissionVerdict(msgspec.Struct, frozen=True):
    """Result of the check of one mission."""

    source: str
    """Text by which the operator gave the mission."""
    sound: bool
    findings: list[Finding]
    mission: str = ""
    """Name of the mission, from its folder or its only file."""


def locate(name: str) -> Path:
    """The file or folder at this path, else the shipped mission of this name.

    Raises: NotFound with the names of the shipped missions.
    """
    path = Path(name)
    if path.exists():
        return path
    shipped = share_dir() / "missions"
    if "/" not in name and (shipped / name).is_dir():
        return shipped / name
    known = ", ".join(sorted(folder.name for folder in shipped.iterdir() if folder.is_dir()))
    raise NotFound(f"mission {name!r}: neither a file or folder nor a shipped mission ({known})")


def check_all(missions: Iterable[str]) -> list[MissionVerdict]:
    """Checks each mission.

    Raises: NotFound when one does not exist.
    """
    out = []
    for name in missions:
        where = locate(name)
        findings = check_files([where])
        out.append(MissionVerdict(name, sound(findings), findings, _name(where)))
    return out


def _name(where: Path) -> str:
    """Name of the mission, from its folder or its only file."""
    path = where.resolve()
    return path.parent.name if path.name == MANIFEST else path.name


def task(
    mission: str, members: Iterable[str], params: Iterable[str], priority: int | None = None
) -> MissionTask:
    """The instruction for a ground station, with the contents of the mission's files.

    Raises: NotFound, ConfigError, InvalidInput for a parameter that is not NAME=VALUE.
    """
    where = locate(mission)
    # by content: the ground station may have another version, or none, of the same name
    files = tuple(read_files(where))
    single = where.is_file() and len(files) == 1
    name = "" if single else (where if where.is_dir() else where.parent).resolve().name
    return MissionTask(name, files, dict(_param(text) for text in params), tuple(members), priority)


def _param(text: str) -> tuple[str, ParamValue]:
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise InvalidInput(f"--set {text!r}: expected NAME=VALUE, such as speed_m_s=1.0")
    try:
        found = json.loads(value)
    except RecursionError:
        raise InvalidInput(
            f"--set {name}: nested too deep; expected a number, a word, true, false or points"
        ) from None
    except ValueError:
        return name, value  # a plain word needs no quotes
    try:
        return name, msgspec.convert(found, ParamValue)
    except msgspec.ValidationError as error:
        raise InvalidInput(
            f"--set {name}: {error}; expected a number, a word, true, false or points"
        ) from error


class MissionVerdicts(msgspec.Struct, frozen=True):
    """Results of the checks of missions."""

    missions: list[MissionVerdict]


def check_missions(missions: Iterable[str], out: Output) -> None:
    """Prints the result of each check and its findings.

    Raises: MissionError when one has errors; as `check_all`.
    """
    verdicts = check_all(missions)
    if out.settings.structured:
        out.document(MissionVerdicts(verdicts))
    else:
        rows = [(v.mission, "sound" if v.sound else "refused", len(v.findings)) for v in verdicts]
        out.table([Column("MISSION"), Column("VERDICT"), Column("FINDINGS", right=True)], rows)
        for verdict in verdicts:
            for finding in verdict.findings:
                out.text(str(finding))
    if not all(verdict.sound for verdict in verdicts):
        bad = ", ".join(verdict.mission for verdict in verdicts if not verdict.sound)
        raise MissionError(f"mission {bad}: must not be flown; expected no finding of level error")
