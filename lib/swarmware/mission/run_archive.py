"""Reads the folders of the runs that a platform has played: `<data_dir>/missions/<UTC time>-<name>/`."""

import re
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from swarmware.errors import ConfigError
from swarmware.model import document
from swarmware.types.mission import MissionProgress
from swarmware.types.mission_run import RunRecord

RECORD: Final = "run.json"
DOCUMENT: Final = "document.json"
"""The mission as it ran. A folder with a `mission.json` would count as a mission of the store."""
PROGRESS: Final = "progress.jsonl"
_NAME: Final = re.compile(r"\d{8}T\d{6}Z-.+")


class StoredRun(NamedTuple):
    """A run on the disk."""

    folder: Path
    record: RunRecord


def run_folders(missions: Path) -> list[Path]:
    """Folders of runs, oldest first; a platform that played none has no folder."""
    try:
        return sorted(path for path in missions.iterdir() if _NAME.fullmatch(path.name) and path.is_dir())
    except OSError:
        return []


def stored_runs(missions: Path) -> list[StoredRun]:
    """The runs that can be read, oldest first."""
    found = []
    for folder in run_folders(missions):
        file = folder / RECORD
        try:
            found.append(StoredRun(folder, document.json(document.read(file), RunRecord, str(file))))
        except (ConfigError, OSError):
            continue  # the disk was full, or the power failed, when it was written
    return found


def document_of(folder: Path) -> str:
    """BDL text of a run, or "" if it cannot be read."""
    try:
        return document.read(folder / DOCUMENT)
    except (ConfigError, OSError):
        return ""  # the disk was full when it was written; the rest of the run is shown


def progress_of(folder: Path, limit: int) -> tuple[MissionProgress, ...]:
    """The newest steps of a run in their order; a line that was cut by a full disk is left out."""
    try:
        lines = (folder / PROGRESS).read_bytes().splitlines()
    except OSError:
        return ()
    found = []
    for line in lines[-limit:]:
        try:
            found.append(msgspec.json.decode(line, type=MissionProgress))
        except msgspec.DecodeError:
            continue
    return tuple(found)
