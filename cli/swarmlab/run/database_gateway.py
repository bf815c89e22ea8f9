"""`python -m swarmlab.run.database_gateway FOLDER`: connects a lab in namespaces with its database.

It listens on a socket in the folder of the lab, which the namespaces share, and opens one connection to the
server for each connection of a node.
"""

import asyncio
import logging
import signal
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

from swarmctl.session import labs
from swarmlab.provision.database import SOCKET, DatabaseServer, server_of
from swarmware.service.notify import Notifier

CHUNK_BYTES: Final = 1 << 16

log = logging.getLogger("swarm.database")


class DatabaseGateway:
    """Forwards connections from the socket of the lab to the server."""

    def __init__(self, socket: Path, server: DatabaseServer) -> None:
        self._socket = socket
        self._server = server
        self._reachable = True

    async def run(self) -> None:
        """Forwards until SIGTERM or SIGINT."""
        loop, ended = asyncio.get_running_loop(), asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, ended.set)
        listening = await asyncio.start_unix_server(self._serve, self._socket)
        try:
            # ready without a try: the server may come later, and loggers repeat their connection
            Notifier().ready(f"gateway to {self._server.host}:{self._server.port}")
            await ended.wait()
        finally:
            listening.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Copies both directions of one connection until an end closes."""
        try:
            from_server, to_server = await asyncio.open_connection(self._server.host, self._server.port)
        except OSError as error:
            self._note(reachable=False, reason=str(error))
            writer.close()  # the logger reports its database as unreachable, and tries again
            return
        self._note(reachable=True)
        try:
            async with asyncio.TaskGroup() as directions:
                directions.create_task(_copy(reader, to_server), name="to the database")
                directions.create_task(_copy(from_server, writer), name="from the database")
        finally:
            to_server.close()
            writer.close()

    def _note(self, *, reachable: bool, reason: str = "") -> None:
        """Logs a change once, not each attempt of each node."""
        if reachable != self._reachable:
            self._reachable = reachable
            log.warning("database %s: %s", self._server.host, reason or "reachable again")


async def _copy(source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
    with suppress(OSError):  # a connection that breaks has ended
        while data := await source.read(CHUNK_BYTES):
            target.write(data)
            await target.drain()
    with suppress(OSError):  # the other side has closed first
        target.write_eof()


def main() -> None:
    """Runs the gateway of the lab in the folder that is the argument."""
    folder = Path(sys.argv[1])
    server = server_of(labs.load(folder).mongodb_uri)
    assert server is not None, "a socket of the file system needs no gateway"
    asyncio.run(DatabaseGateway(folder / SOCKET, server).run())


if __name__ == "__main__":
    main()
