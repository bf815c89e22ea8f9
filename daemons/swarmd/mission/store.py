"""Missions on disk: folders of this node first, then the installed ones."""

from pathlib import Path

from swarmd.mission.checking import Checker
from swarmware.errors import ConfigError, NotFound
from swarmware.mission.finding import sound
from swarmware.mission.folder import Folder, is_mission, read_folder
from swarmware.types.mission import StoredMission


class MissionStore:
    """Mission folders, each with a mission.toml, by name."""

    def __init__(self, places: tuple[Path, ...], checker: Checker) -> None:
        self._places = places
        self._checker = checker
        self._known: dict[str, Folder] = {}

    def folder(self, name: str) -> Folder:
        """The mission folder of that name.

        Raises: NotFound with the known names; ConfigError when its manifest is invalid.
        """
        found = self._folders()
        if name not in found:
            known = ", ".join(sorted(found)) or "(the store is empty)"
            raise NotFound(f"mission {name!r}: not in the store; expected one of: {known}")
        return self._read(found[name])

    @property
    def read(self) -> list[Folder]:
        """Missions that were read from disk and are cached."""
        return list(self._known.values())

    def known(self, digest: str) -> Folder | None:
        """The stored mission with this content, if it was read before."""
        return self._known.get(digest)

    def _read(self, path: Path) -> Folder:
        folder = read_folder(path)
        self._known[folder.hash] = folder
        return folder

    async def list(self) -> tuple[StoredMission, ...]:
        """All missions, including those with errors."""
        self._known.clear()
        return tuple([await self._entry(name, path) for name, path in sorted(self._folders().items())])

    async def _entry(self, name: str, path: Path) -> StoredMission:
        try:
            folder = self._read(path)
        except ConfigError as error:
            return StoredMission(name, str(error), "", (), False, 1)
        findings = await self._checker.check(folder)
        roles = tuple(role.name for role in folder.manifest.roles)
        return StoredMission(name, folder.manifest.title, folder.hash, roles, sound(findings), len(findings))

    def _folders(self) -> dict[str, Path]:
        found: dict[str, Path] = {}
        for place in self._places:
            if place.is_dir():
                for path in sorted(place.iterdir()):
                    if path.is_dir() and is_mission(path):
                        found.setdefault(path.name, path)
        return found
