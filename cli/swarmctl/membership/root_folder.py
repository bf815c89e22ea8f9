"""The folder of the swarm's root on this computer or on a stick, and the invitations that were made there."""

import fcntl
import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import msgspec

from swarmware.errors import ConfigError, Denied, NotFound
from swarmware.model import document
from swarmware.runtime.filewriter import replace_file
from swarmware.transport.enrolment.inviter import Invitation
from swarmware.transport.enrolment.messages import JoinRefusal
from swarmware.transport.enrolment.token import fingerprint
from swarmware.transport.security.keys import ROOT_PUBLIC, ROSTER
from swarmware.transport.security.root import ROOT_KEY, Root

INVITATIONS: Final = "invitations.json"
LOCK: Final = "lock"
KEPT_MAX: Final = 256
"""Maximum invitations in the record; the oldest are forgotten."""


class RecordedInvitation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An invitation without its secret, to refuse its token later with the reason."""

    number: str
    """Number of the token, hexadecimal."""
    platform: str
    role: str
    expires_utc_s: int
    used: bool = False
    serial: int = 0
    """Serial of the member that a file admitted in advance, or 0 for an invitation over the network."""


def default_root() -> Path:
    """Folder of the root unless an option names another one."""
    data = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local/share"
    return Path(data) / "swarmware" / "root"


class RootFolder:
    """The root's files, changed by one command at a time."""

    def __init__(self, path: Path | None) -> None:
        self.path = path or default_root()

    @property
    def exists(self) -> bool:
        """Whether the folder contains a root."""
        return (self.path / ROOT_KEY).exists()

    @property
    def fingerprint(self) -> str:
        """Fingerprint of the root in the folder, or "" without a root."""
        path = self.path / ROOT_PUBLIC
        return fingerprint(path.read_bytes()) if self.exists and path.exists() else ""

    def load(self) -> Root:
        """The root in the folder.

        Raises: NotFound without a root; ConfigError, Denied when its files are damaged or not private.
        """
        if not self.exists:
            raise NotFound(
                f"{self.path}: the swarm's root key is not in it; expected the folder that"
                " `swarmctl keys init` made, with --root DIR when it is on a stick or was moved"
            )
        if not os.access(self.path / ROOT_KEY, os.R_OK):
            raise Denied(f"{self.path / ROOT_KEY}: not readable by this user; expected its owner")
        return Root.load(self.path)

    def continue_from(self, signed: bytes) -> None:
        """Continue an older copy of the folder from a newer roster of the same root. Raises: OSError."""
        with self.locked():
            replace_file(self.path / ROSTER, signed, mode=0o644)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock of the root's files against other commands; creates the folder for this user alone."""
        self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor = os.open(self.path / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            yield
        finally:
            os.close(descriptor)  # releases the lock; the file stays, as a new one would be a second lock

    def refused(self, utc_s: int) -> dict[bytes, JoinRefusal]:
        """Numbers of earlier tokens, each with the reason of its refusal."""
        return {
            bytes.fromhex(one.number): JoinRefusal.USED
            if one.used
            else JoinRefusal.EXPIRED
            if one.expires_utc_s <= utc_s
            else JoinRefusal.ENDED
            for one in self._record()
        }

    def unused_files(self) -> dict[tuple[str, int], int]:
        """Expiry in UTC of each file that was not seen in use, by platform and serial of its member."""
        return {
            (one.platform, one.serial): one.expires_utc_s
            for one in self._record()
            if one.serial and not one.used
        }

    def note_used(self, members: Collection[tuple[str, int]]) -> None:
        """Note that the files of these members were used. Raises: OSError."""
        with self.locked():
            kept = [
                msgspec.structs.replace(one, used=True) if (one.platform, one.serial) in members else one
                for one in self._record()
            ]
            replace_file(self.path / INVITATIONS, msgspec.json.encode(kept), mode=0o600)

    def record(self, *invitations: Invitation, used: bool = False, serial: int = 0) -> None:
        """Add invitations to the record, or note their use; `serial` of the member that a file admits."""
        with self.locked():
            known = {one.number: one for one in self._record()}
            for one in invitations:
                number, expires_utc_s = one.token.number.hex(), one.token.expires_utc_s
                known[number] = RecordedInvitation(
                    number, one.platform, one.role, expires_utc_s, used, serial
                )
            kept = list(known.values())[-KEPT_MAX:]
            replace_file(self.path / INVITATIONS, msgspec.json.encode(kept), mode=0o600)

    def _record(self) -> list[RecordedInvitation]:
        path = self.path / INVITATIONS
        try:
            found = document.json(document.read(path), list[RecordedInvitation], str(path))
            for one in found:
                bytes.fromhex(one.number)  # only a check: `refused` needs the bytes
        except FileNotFoundError:
            return []
        except ConfigError:
            raise
        except ValueError as error:
            raise ConfigError(
                f"{path}: number of an invitation: {error}; expected digits 0-9, a-f"
            ) from error
        return found
