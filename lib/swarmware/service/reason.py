"""Expected errors in one line: the failure, its place, and the expected condition."""

import errno
import os
from typing import Final

from swarmware.errors import SwarmError

EXPECTED: Final = {
    errno.EMFILE: "a higher limit of open files (ulimit -n, LimitNOFILE=)",
    errno.ENFILE: "a higher limit of open files of the machine (fs.file-max)",
    errno.ENOSPC: "room on its file system",
    errno.EDQUOT: "room within the quota",
    errno.EROFS: "a file system that may be written",
    errno.EACCES: "permission for the user of this node",
    errno.EPERM: "permission for the user of this node",
    errno.ENOMEM: "free memory",
    errno.EIO: "a medium that works",
}


def reason(error: BaseException) -> str | None:
    """The line for an error of the environment, or None for a defect, which needs its traceback."""
    while isinstance(error, BaseExceptionGroup) and len(error.exceptions) == 1:
        error = error.exceptions[0]
    if isinstance(error, BaseExceptionGroup):
        reasons = [reason(one) for one in error.exceptions]
        if None in reasons:
            return None
        return "; ".join(dict.fromkeys(text for text in reasons if text is not None))
    if isinstance(error, SwarmError):
        return str(error)
    if isinstance(error, OSError) and error.errno in EXPECTED:
        where = f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, str | bytes) else ""
        return f"{where}{os.strerror(error.errno).lower()}; expected {EXPECTED[error.errno]}"
    return None
