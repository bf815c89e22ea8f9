"""The shell of `files`: serves offers, blocks and reads of other platforms."""

import asyncio
from pathlib import Path
from typing import Final

from swarmd.files import config as settings
from swarmd.files.core.intake import FileIntake
from swarmd.files.store import FileStore
from swarmware.errors import ConfigError, Conflict, InvalidInput, NotFound, OutOfRange
from swarmware.model.clock import utc_ns
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.service.service import Service
from swarmware.types.file import (
    FileBlock,
    FileData,
    FileEntry,
    FileListing,
    FileOffer,
    FileProgress,
    FileQuery,
    FileRead,
    FileReceived,
)

RECEIVED: Final = "files/received"


class Files(Service):
    """Receives and serves files; the access rules of `sys/files/*` apply to each request."""

    name = "files"
    Config = settings.Config
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        """Raises: ConfigError when the folder cannot be created."""
        super().__init__(module, config)
        folder = Path(config.folder) if config.folder else module.node.config.data_path / "files"
        try:
            self._store = FileStore(folder)
        except OSError as error:
            raise ConfigError(f"services/files.toml: folder {folder}: {error.strerror}") from error
        self._intake = FileIntake(config)
        self._work = asyncio.Lock()
        """Lock that lets one long operation run at a time, such as the digest of a file."""
        self._received = module.stream_writer(
            RECEIVED, FileReceived, kind="event", log="all", description="Files that were stored, and by whom"
        )
        module.serve(
            "sys/files/offer", FileOffer, self._offer, reply=FileProgress, description="Offers a file"
        )
        module.serve(
            "sys/files/write", FileBlock, self._write, reply=FileProgress, description="Sends a block"
        )
        module.serve("sys/files/list", FileQuery, self._list, reply=FileListing, description="Lists files")
        module.serve(
            "sys/files/read", FileRead, self._read, reply=FileData, description="Reads a block of a file"
        )

    async def run(self) -> None:
        """Serve the files until cancelled."""
        # files of a previous run are known by their names only, so their age decides
        removed = await asyncio.to_thread(self._store.remove_old, utc_ns() / 1e9 - self.config.keep_parts_s)
        if removed:
            self.module.log.info("%d incomplete files removed, which were not continued", removed)
        try:
            await asyncio.Event().wait()
        finally:
            self._store.close()

    async def _offer(self, offer: FileOffer, meta: Meta) -> FileProgress:
        async with self._work:
            # a repeated offer after a lost answer is done already
            if await asyncio.to_thread(self._store.has_content, offer.name, offer.digest):
                return FileProgress(complete=True)
            stored_bytes = await asyncio.to_thread(self._store.stored_bytes)
            for digest in self._intake.on_offer(offer, stored_bytes, self.module.now_ns()):
                self._store.drop(digest, discard=True)
            try:
                part = await asyncio.to_thread(self._store.part, offer)
            except OSError as error:
                self._intake.on_ended(offer.digest)
                raise OutOfRange(f"{offer.name}: {self._store.folder}: {error.strerror}") from error
            except OutOfRange:
                self._intake.on_ended(offer.digest)
                raise
            if part.blocks.missing:
                return FileProgress(complete=False, missing=part.blocks.ranges())
            return await self._finish(offer, meta)

    async def _write(self, block: FileBlock, meta: Meta) -> FileProgress:
        offer = self._intake.on_block(block.name, block.digest, self.module.now_ns())
        if offer is None:
            if await asyncio.to_thread(self._store.has_content, block.name, block.digest):
                return FileProgress(complete=True)
            raise Conflict(f"{block.name}: a block of a file that was not offered; expected an offer first")
        try:
            part = self._store.part(offer)
            part.write(block.offset, block.data)
        except OSError as error:
            raise OutOfRange(f"{block.name}: {self._store.folder}: {error.strerror}") from error
        if part.blocks.missing:
            return FileProgress(complete=False)
        async with self._work:
            # a repeated last block may wait for the lock while the first one finishes the file
            if self._intake.on_block(block.name, block.digest, self.module.now_ns()) is None:
                return FileProgress(complete=True)
            return await self._finish(offer, meta)

    async def _finish(self, offer: FileOffer, meta: Meta) -> FileProgress:
        try:
            await asyncio.to_thread(self._store.finish, offer)
        except InvalidInput:
            # the blocks do not have the offered digest, so none of them can be trusted
            self._store.drop(offer.digest, discard=True)
            self._intake.on_ended(offer.digest)
            raise
        except OSError as error:
            raise OutOfRange(f"{offer.name}: {self._store.folder}: {error.strerror}") from error
        self._intake.on_ended(offer.digest)
        by = "" if meta.sender is None else str(meta.sender)
        self.module.log.info(
            "file %s stored: %d bytes, from %s", offer.name, offer.size_bytes, by or self.module.platform
        )
        self._received.write(FileReceived(offer.name, offer.size_bytes, offer.digest, by))
        return FileProgress(complete=True)

    async def _entry(self, name: str) -> FileEntry:
        async with self._work:
            return await asyncio.to_thread(self._store.entry, name)

    async def _list(self, query: FileQuery, _: Meta) -> FileListing:
        async with self._work:
            stored_bytes = await asyncio.to_thread(self._store.stored_bytes)
        free_bytes = self._intake.free_bytes(stored_bytes)
        if query.name:
            return FileListing((await self._entry(query.name),), free_bytes)
        return FileListing(tuple(await asyncio.to_thread(self._store.entries)), free_bytes)

    async def _read(self, wanted: FileRead, _: Meta) -> FileData:
        entry = await self._entry(wanted.name)
        if entry.digest != wanted.digest:
            raise Conflict(
                f"file {wanted.name!r}: it has changed; expected the content {wanted.digest.hex()[:16]}"
            )
        if wanted.offset >= max(entry.size_bytes, 1):
            raise NotFound(f"file {wanted.name!r}: {entry.size_bytes} bytes; no block at {wanted.offset}")
        return FileData(await asyncio.to_thread(self._store.read, wanted.name, wanted.offset))
