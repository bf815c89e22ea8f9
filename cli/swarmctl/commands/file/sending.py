"""`swarmctl file send`: offers a file, and sends the blocks that are missing."""

import asyncio
from pathlib import Path

from swarmctl.commands.file.blocks import SLOW_TIMEOUT_S, MovedFile, move_blocks
from swarmctl.session.session import Session
from swarmctl.terminal.progress import Progress
from swarmware.errors import InvalidInput
from swarmware.transport.transfer.block_set import BLOCK_BYTES, FILE_BYTES_MAX, RANGES_MAX, block_count
from swarmware.transport.transfer.partial_file import digest_of, regular_file_size
from swarmware.types.bounds import is_file_name
from swarmware.types.file import FileBlock, FileOffer, FileProgress


async def send_file(session: Session, file: Path, name: str, give_up_s: float) -> None:
    """Returns when the node has the file in its place.

    Raises: InvalidInput for a name that no file there may have; NoAnswer; Denied; OutOfRange when the node
    has no room.
    """
    if not is_file_name(name):
        raise InvalidInput(
            f"file name {name!r}: expected at most 100 letters, digits and . _ + -, without folders; use --as"
        )
    try:
        size_bytes = regular_file_size(file, FILE_BYTES_MAX)
        digest = await asyncio.to_thread(digest_of, file)
        content = await asyncio.to_thread(file.open, "rb")
    except OSError as error:
        raise InvalidInput(f"{file}: {error.strerror}") from error
    offer, resumed_bytes = FileOffer(name, size_bytes, digest), None
    path = session.path("sys/files")
    with content, Progress(session.out, f"{session.platform}: {name}", block_count(size_bytes)) as progress:

        async def write(number: int, timeout_s: float) -> FileProgress:
            offset = number * BLOCK_BYTES
            content.seek(offset)
            block = FileBlock(name, digest, offset, content.read(BLOCK_BYTES))
            # the node may check the whole file before it answers the last block
            is_last = BLOCK_BYTES * (number + 1) >= size_bytes
            return await session.module.request(
                f"{path}/write",
                block,
                FileProgress,
                timeout_s=SLOW_TIMEOUT_S if is_last else timeout_s,
                bulk=True,
            )

        # again, since the node states at most RANGES_MAX gaps in one answer
        while True:
            timeout_s = min(give_up_s, SLOW_TIMEOUT_S)
            state = await session.ask("sys/files/offer", offer, FileProgress, timeout_s=timeout_s)
            missing = sum(last - first + 1 for first, last in state.missing)
            if resumed_bytes is None:
                # a list of the maximum length may be cut, so the held blocks are not known
                held = block_count(size_bytes) - missing if len(state.missing) < RANGES_MAX else 0
                resumed_bytes = size_bytes if state.complete else held * BLOCK_BYTES
                progress.at(resumed_bytes // BLOCK_BYTES)
            if state.complete:
                break
            await move_blocks(session, state.missing, write, give_up_s, progress)
    found = MovedFile(session.platform, name, size_bytes, digest.hex(), resumed_bytes)
    if session.settings.structured:
        session.out.document(found)
    else:
        session.out.text(f"{session.platform}: {name} stored, {size_bytes} bytes{_resumed(resumed_bytes)}")


def _resumed(resumed_bytes: int) -> str:
    return f", {resumed_bytes} of them were there" if resumed_bytes else ""
