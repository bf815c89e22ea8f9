"""Journal of the monitor with registrations and open faults, restored after a kill (S1.25)."""

from pathlib import Path

import msgspec

from swarmware.errors import ConfigError
from swarmware.model import document
from swarmware.runtime.filewriter import replace_file
from swarmware.types.health import CheckRegistration, Fault


class Journal(msgspec.Struct, frozen=True):
    """Journal of one start of the node; the next start begins with an empty journal."""

    boot_id: int
    registrations: tuple[CheckRegistration, ...] = ()
    faults: tuple[Fault, ...] = ()


class JournalFile:
    """Small file, replaced atomically, so that a kill leaves the previous content intact."""

    def __init__(self, folder: Path, boot_id: int) -> None:
        self._path = folder / "journal.json"
        self._boot_id = boot_id

    def load(self) -> Journal:
        """Loads the journal of this start of the node; missing or unreadable journals count as empty."""
        empty = Journal(self._boot_id)
        try:
            found = document.json(document.read(self._path), Journal, str(self._path))
        except (FileNotFoundError, ConfigError):
            return empty
        # faults of an earlier start of the node do not concern this one
        return found if found.boot_id == self._boot_id else empty

    def save(self, registrations: tuple[CheckRegistration, ...], faults: tuple[Fault, ...]) -> None:
        """Replaces the file, which survives a kill of the monitor; it is not synced to disk.

        Raises: OSError when it cannot be written; the previous journal is then unchanged.
        """
        self._path.parent.mkdir(mode=0o750, parents=True, exist_ok=True)
        data = msgspec.json.encode(Journal(self._boot_id, registrations, faults))
        replace_file(self._path, data, durable=False)
