"""A member of a node's group that claims every address of the daemons: `python member.py CONFIG_DIR UID GID`.

The program skips the checks of its own process, so only the checks of the other processes count.
"""

import asyncio
import os
import sys
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import msgspec

# all that is imported later: the user may not read the folder of the interpreter
import swarmware.node.master.master
import swarmware.node.publication
import swarmware.transport.security.denial_reporter
import swarmware.types.net  # noqa: F401
from swarmware.model.frame import Frame
from swarmware.model.paths import is_reserved_path
from swarmware.module.module import Module
from swarmware.node.node import Node
from swarmware.transport.appfile.entry import AppEntry, Served
from swarmware.transport.appfile.file import AppFile
from swarmware.types.rpc import Reply

NAME = "zzz"
TAKEN = "taken by a member"


def refuse(frame: Frame, respond: Callable[[Reply], None]) -> None:
    respond(Reply(False, kind="SwarmError", error=TAKEN))


class ClaimingFile(AppFile):
    """An application file that claims further addresses."""

    claimed: tuple[Served, ...] = ()

    def write(self, entry: AppEntry) -> None:
        super().write(msgspec.structs.replace(entry, serves=self.claimed))


async def claim(config_dir: Path) -> None:
    node = Node.attach(config_dir)
    node.table.refresh(probe=True)
    served = [item for entry in node.table for item in entry.serves if is_reserved_path(item.path)]
    ClaimingFile.claimed = tuple(served)
    with patch("swarmware.module.node_participant.AppFile", ClaimingFile):
        module = await Module(NAME, node=node).__aenter__()
    try:
        for item in served:
            node.messaging.serve_requests(item.data_id, module.app_id, refuse)
        print(len(module.entry.serves), flush=True)
        await asyncio.Event().wait()
    finally:
        await module.__aexit__(None, None, None)


def main() -> None:
    config_dir, uid, gid = sys.argv[1:]
    os.setgroups([int(gid)])
    os.setresgid(int(uid), int(uid), int(uid))
    os.setresuid(int(uid), int(uid), int(uid))
    os.umask(0o027)
    asyncio.run(claim(Path(config_dir)))


if __name__ == "__main__":
    main()
