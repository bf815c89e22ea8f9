"""`swarmctl file get`: asks for the blocks of a file that are missing here."""

import asyncio
from pathlib import Path

from swarmctl.commands.file.blocks import SLOW_TIMEOUT_S, MovedFile, move_blocks
from swarmctl.session.session import Session
from swarmctl.terminal.progress import Progress
from swarmware.errors import InvalidInput, WireError
from swarmware.transport.transfer.block_set import BLOCK_BYTES, block_count
from swarmware.transport.transfer.partial_file import PartialFile
from swarmware.types.bounds import is_file_name
from swarmware.types.file import FileData, FileListing, FileQuery, FileRead


async def get_file(session: Session, name: str, target: Path, give_up_s: float) -> None:
    """Returns when the file is in its place here.

    Raises: NotFound; NoAnswer; Denied; InvalidInput for a name with folders, or a target that cannot be
    written; Conflict when the file changed meanwhile; WireError for an answer about another file.
    """
    if not is_file_name(name):
        raise InvalidInput(
            f"file name {name!r}: expected one without folders, such as `swarmctl file ls` prints it"
        )
    timeout_s = min(give_up_s, SLOW_TIMEOUT_S)
    listing = await session.ask("sys/files/list", FileQuery(name), FileListing, timeout_s=timeout_s)
    # the answer comes from another computer and names the file that is written here
    if [entry.name for entry in listing.files] != [name]:
        raise WireError(f"{session.platform}: its answer is not about the file {name!r}; expected one entry")
    entry = listing.files[0]
    if await asyncio.to_thread(target.is_dir):
        target /= name
    path = session.path("sys/files/read")
    try:
        # in the folder of the target: a rename within a file system is atomic
        part = PartialFile(target.parent, entry.digest, entry.size_bytes)
    except OSError as error:
        raise InvalidInput(f"{target}: {error.strerror}") from error
    blocks = part.blocks
    resumed_bytes = (len(blocks) - blocks.missing) * BLOCK_BYTES
    try:
        with Progress(session.out, f"{session.platform}: {name}", block_count(entry.size_bytes)) as progress:
            progress.at(len(blocks) - blocks.missing)

            async def read(number: int, timeout_s: float) -> None:
                wanted = FileRead(entry.name, entry.digest, number * BLOCK_BYTES)
                found = await session.module.request(path, wanted, FileData, timeout_s=timeout_s, bulk=True)
                part.write(wanted.offset, found.data)

            await move_blocks(session, blocks.ranges(len(blocks)), read, give_up_s, progress)
        await asyncio.to_thread(part.finish, target)
    except OSError as error:
        raise InvalidInput(f"{target}: {error.strerror}") from error
    finally:
        part.close()
    moved = MovedFile(
        session.platform, name, entry.size_bytes, entry.digest.hex(), resumed_bytes, str(target)
    )
    if session.settings.structured:
        session.out.document(moved)
    else:
        session.out.text(f"{target}: {entry.size_bytes} bytes from {session.platform}")
