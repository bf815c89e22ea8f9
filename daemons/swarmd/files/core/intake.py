"""Acceptance of offered files, and eviction of incomplete files that are not continued."""

from typing import Final

import msgspec

from swarmd.files.config import Config
from swarmware.errors import Conflict, OutOfRange
from swarmware.types.file import FileOffer

PARTS_MAX: Final = 16
"""Maximum number of incomplete files at a time."""


class IncompleteFile(msgspec.Struct):
    """An accepted file whose blocks are still arriving."""

    offer: FileOffer
    touched_ns: int


class FileIntake:
    """Incomplete files by digest, and the storage that is left for further ones."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._parts: dict[bytes, IncompleteFile] = {}

    def free_bytes(self, stored_bytes: int) -> int:
        """Bytes left for new offers; incomplete files count with their full size."""
        # an accepted file must not fail because another one took its space
        promised = sum(part.offer.size_bytes for part in self._parts.values())
        return max(0, self._config.limit_bytes - stored_bytes - promised)

    def on_offer(self, offer: FileOffer, stored_bytes: int, now_ns: int) -> list[bytes]:
        """Accepts an offer; returns the digests of the incomplete files that were evicted as stale.

        Raises: OutOfRange for a file that is too large, Conflict while too many other files arrive.
        """
        part = self._parts.get(offer.digest)
        if part is not None:
            # blocks are stored by the digest of the content, so one content can have one name only
            if part.offer.name != offer.name:
                raise Conflict(
                    f"{offer.name}: the same content arrives as {part.offer.name}; expected one of them"
                )
            part.touched_ns = now_ns
            return []
        # before the limits are checked: stale files free their bytes and their place
        gone = self._give_up(now_ns)
        config = self._config
        if offer.size_bytes > config.file_limit_bytes:
            limit = f"expected at most {config.file_limit_bytes} (file_limit_bytes)"
            raise OutOfRange(f"{offer.name}: {offer.size_bytes} bytes; {limit}")
        free = self.free_bytes(stored_bytes)
        if offer.size_bytes > free:
            room = f"{free} of {config.limit_bytes} (limit_bytes) are free"
            raise OutOfRange(f"{offer.name}: {offer.size_bytes} bytes; {room}")
        if len(self._parts) >= PARTS_MAX:
            raise Conflict(
                f"{offer.name}: {PARTS_MAX} other files arrive; expected fewer; offer it again after them"
            )
        self._parts[offer.digest] = IncompleteFile(offer, now_ns)
        return gone

    def on_block(self, name: str, digest: bytes, now_ns: int) -> FileOffer | None:
        """The offer to which a block belongs, or None if the file was not offered."""
        part = self._parts.get(digest)
        if part is None or part.offer.name != name:
            return None
        part.touched_ns = now_ns
        return part.offer

    def on_ended(self, digest: bytes) -> None:
        """Forgets a file that is complete or was refused."""
        self._parts.pop(digest, None)

    def _give_up(self, now_ns: int) -> list[bytes]:
        keep_ns = round(self._config.keep_parts_s * 1e9)
        gone = [digest for digest, part in self._parts.items() if now_ns - part.touched_ns > keep_ns]
        for digest in gone:
            del self._parts[digest]
        return gone
