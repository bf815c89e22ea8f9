"""The session number of a broker, which rises with each start."""

from pathlib import Path

from swarmware.runtime.filewriter import replace_file


def next_session(path: Path, wanted: int) -> int:
    """A session number above all earlier ones of this node, stored in a file.

    `wanted` is a wall-clock stamp; the file ensures that the number increases when that clock is set back,
    because neighbours refuse old sessions and a repeated one would repeat nonces.
    """
    try:
        before = int.from_bytes(path.read_bytes()[:8], "little")
    except FileNotFoundError:
        before = 0
    session = max(wanted, before + 1)
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, session.to_bytes(8, "little"), mode=0o600)
    return session
