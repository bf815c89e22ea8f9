"""Access to a node's folders: by its own user only, or by the members of a group, too.

The mode of the run directory decides: the group that may read it may join. Members then create application
files, sockets and doorbells beside the own user's, read its boards and write their own. Folders are sticky:
only its owner, or the owner of the folder, can remove a file. No bit is set that makes files inherit the
group, because the hardened units may not set it.
"""

import os
import pwd
import stat
from pathlib import Path
from typing import Final

from swarmware.errors import Denied
from swarmware.transport.shm.shared_file import kind_at

_GROUP_READS: Final = 0o050
_SHARED_FOLDER: Final = 0o1770
_GUEST_FOLDER: Final = 0o770
_PRIVATE_FOLDER: Final = 0o700


def make_folder(path: Path, like: Path) -> None:
    """Create the folder, if it is missing, with the group of another one.

    Raises: PermissionError.
    """
    try:
        path.mkdir(mode=_PRIVATE_FOLDER, parents=True)
    except FileExistsError:
        return
    share_folder(path, like)


def share_folder(path: Path, like: Path) -> None:
    """Give a folder that this process created the group of another one.

    A guest's folder is not sticky, so that the owner of the node can remove files from it.
    """
    share(path, like, _GUEST_FOLDER if is_guest(like) else _SHARED_FOLDER)


def share(target: Path | int, folder: Path, mode: int) -> None:
    """Give a file of this process the group of its folder and this mode, except in a private folder.

    A file of root is given to the owner of the folder, whose processes could not use it otherwise.
    """
    theirs, ours = folder.stat(), os.stat(target)  # noqa: PTH116 - of a descriptor, too
    shared = theirs.st_mode & _GROUP_READS == _GROUP_READS
    uid = theirs.st_uid if os.geteuid() == 0 else ours.st_uid
    gid = theirs.st_gid if shared else ours.st_gid
    try:
        if (uid, gid) != (ours.st_uid, ours.st_gid):  # the hardened units may not even try
            os.chown(target, uid, gid)
        if shared:
            os.chmod(target, mode)  # noqa: PTH101 - of a descriptor, too
    except PermissionError:
        return  # not a member of that group: the file stays private


def node_users(run_dir: Path) -> frozenset[int]:
    """Users whose files a node trusts: the owner of its run directory, and root."""
    return frozenset({0, run_dir.stat().st_uid})


def check_folder(path: Path, users: frozenset[int]) -> None:
    """Check that the folder, if it exists, belongs to one of the users, and not all users may write it.

    Raises: Denied when it belongs to another user, or is not a folder.
    """
    try:
        found = path.lstat()
    except FileNotFoundError:
        return
    node_user = user_name(max(users))
    expected = f"expected none, or a folder of {node_user} that only its group may write; remove it"
    if not stat.S_ISDIR(found.st_mode):
        raise Denied(f"{path}: {kind_at(path)}; {expected}")
    if found.st_uid not in users:
        raise Denied(f"{path}: a folder of {user_name(found.st_uid)}; {expected}")
    if found.st_mode & stat.S_IWOTH:
        raise Denied(f"{path}: a folder that all users may write; {expected}")


def is_guest(run_dir: Path) -> bool:
    """Whether the node belongs to another user: then this process is not its master and removes no files."""
    return run_dir.stat().st_uid != os.geteuid()


def user_name(uid: int) -> str:
    """`user NAME`, or `user UID` for a user without an entry."""
    try:
        return f"user {pwd.getpwuid(uid).pw_name}"
    except KeyError:
        return f"user {uid}"
