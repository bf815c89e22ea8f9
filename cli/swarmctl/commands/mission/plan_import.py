"""Imports a plan of another tool as a mission folder."""

from pathlib import Path

import msgspec

from swarmctl.terminal.output import Output
from swarmware.errors import Conflict, InvalidInput, MissionError, NotFound
from swarmware.geometry.geodesy import LocalMap, Origin
from swarmware.mission.check import check_folder
from swarmware.mission.finding import sound
from swarmware.mission.folder import from_files
from swarmware.mission.installed import installed
from swarmware.mission.manifest import MEMBER_FILE
from swarmware.mission.plans.conversion import ConvertedPlan, convert
from swarmware.mission.plans.plan import Plan, PlannedHome
from swarmware.mission.plans.reader import read_plan
from swarmware.mission.source import SIZE_LIMIT
from swarmware.runtime.filewriter import replace_file
from swarmware.types.mission import MissionFile


class ImportedPlan(msgspec.Struct, frozen=True):
    """Result of an import."""

    mission: str
    """The written folder."""
    items: int
    """Items of the plan and of its surveys."""
    blocks: int
    lat_deg: float
    """Origin of the map on which the mission can start."""
    lon_deg: float
    unsupported: list[str]
    """Parts of the plan that the mission leaves out."""
    warnings: list[str]


def import_plan(
    source: Path, folder: Path | None, origin: tuple[float, float] | None, out: Output, *, skip: bool
) -> None:
    """Writes the mission of a plan after its check; nothing is written if it fails.

    Raises: NotFound; MissionError with each part that cannot be kept, unless `skip`; Conflict when the
    folder exists.
    """
    plan = _read(source)
    home = _origin(plan, origin)
    local = LocalMap(Origin(lat_deg=home.lat_deg, lon_deg=home.lon_deg))
    mission = convert(plan, home, local.to_local)
    if mission.unsupported and not skip:
        lines = [f"{source}:{part.line}: {part}" for part in mission.unsupported]
        raise MissionError("\n".join(lines) + "\nexpected a plan of other items, or --skip-unsupported")
    target = folder or Path(source.stem)
    warnings = [*mission.remarks, *_warnings(mission, target)]
    if target.exists():
        raise Conflict(f"{target}: exists; expected a new folder (-o FOLDER)")
    target.mkdir(parents=True)
    replace_file(target / MEMBER_FILE, mission.text.encode())
    left_out = [str(part) for part in mission.unsupported]
    for text in (*(f"left out: {part}" for part in left_out), *warnings):
        out.warn(text)
    if out.settings.structured:
        done = ImportedPlan(
            str(target), len(plan.items), mission.blocks, home.lat_deg, home.lon_deg, left_out, warnings
        )
        out.document(done)
    else:
        place = f"{home.lat_deg:.7f}, {home.lon_deg:.7f}"
        out.text(f"{target}: {mission.blocks} blocks of {len(plan.items)} items; origin of the map {place}")


def _read(source: Path) -> Plan:
    try:
        with source.open("rb") as file:
            # one byte more than the limit, so that the reader sees that it is exceeded
            data = file.read(SIZE_LIMIT + 1)
    except FileNotFoundError:
        raise NotFound(f"{source}: no such file; expected a plan") from None
    except OSError as error:
        raise InvalidInput(f"{source}: cannot be read: {error.strerror}") from error
    return read_plan(data, str(source))


def _origin(plan: Plan, origin: tuple[float, float] | None) -> PlannedHome:
    height = plan.home.height_amsl_m if plan.home else 0.0
    if origin:
        return PlannedHome(*origin, height)
    if plan.home is None:
        raise MissionError(f"{plan.file}: no home position in it; expected --origin LAT LON")
    return plan.home


def _warnings(mission: ConvertedPlan, target: Path) -> list[str]:
    """Warnings of the check of the mission.

    Raises: MissionError when it has errors.
    """
    catalogue = installed()
    folder = from_files([MissionFile(MEMBER_FILE, mission.text)], str(target), catalogue)
    findings = check_folder(folder, catalogue)
    if not sound(findings):
        raise MissionError("\n".join(str(finding) for finding in findings))
    return [finding.message for finding in findings]
