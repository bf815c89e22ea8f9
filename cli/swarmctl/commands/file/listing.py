"""`swarmctl file ls`: the files of a node."""

from datetime import UTC, datetime

from swarmctl.session.session import Session
from swarmctl.terminal.table import Column
from swarmware.types.file import FileListing, FileQuery


async def list_files(session: Session) -> None:
    """Prints name, size and time of each."""
    found = await session.ask("sys/files/list", FileQuery(), FileListing)
    if session.settings.structured:
        session.out.document(found)
        return
    rows = [
        (
            one.name,
            str(one.size_bytes),
            datetime.fromtimestamp(one.modified_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S"),
        )
        for one in found.files
    ]
    columns = [Column("NAME"), Column("BYTES", right=True), Column("MODIFIED UTC")]
    session.out.table(columns, rows, empty=f"{session.platform}: no files; {found.free_bytes} bytes are free")
