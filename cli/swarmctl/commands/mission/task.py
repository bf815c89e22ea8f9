"""Missions as an operator names them: a shipped one by its name, a folder, a file."""

import json
from collections.abc import Iterable
from pathlib import Path

import msgspec

from swarmware.config import share_dir
from swarmware.errors import InvalidInput, NotFound
from swarmware.mission.check import check_files
from swarmware.mission.finding import Finding, sound
from swarmware.mission.folder import read_files
from swarmware.types.mission import MissionTask, ParamValue


class MissionVerdict(msgspec.Struct, frozen=True):
    """What the check says of one mission."""

    source: str
    sound: bool
    findings: list[Finding]


def locate(name: str) -> Path:
    """The file or folder that is meant: of this path, else shipped under this name.

    Raises: NotFound naming the shipped ones.
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
    """The verdict on each.

    Raises: NotFound when one is not there.
    """
    out = []
    for name in missions:
        findings = check_files([locate(name)])
        out.append(MissionVerdict(name, sound(findings), findings))
    return out


def task(mission: str, members: Iterable[str], params: Iterable[str]) -> MissionTask:
    """The instruction for a ground station, with the mission's files by content: those that `check` looks at.

    Raises: NotFound, ConfigError, InvalidInput for a parameter that is no NAME=VALUE.
    """
    where = locate(mission)
    files = tuple(read_files(where))
    name = "" if len(files) == 1 else (where if where.is_dir() else where.parent).resolve().name
    return MissionTask(name, files, dict(_param(text) for text in params), tuple(members))


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
