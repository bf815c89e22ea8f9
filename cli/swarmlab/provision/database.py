"""The way from a network namespace to the database of a lab: one socket in the folder of the lab.

Namespaces share the file system, but no network. A gateway outside of them connects the socket with the
server.
"""

import re
from pathlib import Path
from typing import Final
from urllib.parse import quote, unquote, urlsplit

import msgspec

from swarmware.errors import InvalidInput
from swarmware.recorder.address import without_password

SOCKET: Final = "mongodb.sock"
"""File in the folder of the lab; the driver recognises a socket by the ending."""
PORT: Final = 27017
"""Default port of MongoDB."""
_URI: Final = re.compile(
    r"mongodb://(?P<user>[^@/?]*@)?(?P<hosts>[^@/?]+)(?P<database>/[^?]*)?(\?(?P<options>.*))?\Z"
)
_UNNAMED: Final = ("tlsallowinvalidhostnames", "tlsinsecure")
"""Options of an address whose server may have a certificate for any name."""


class DatabaseServer(msgspec.Struct, frozen=True):
    """Where the server of a database listens."""

    host: str
    port: int


def server_of(uri: str) -> DatabaseServer | None:
    """The server that a gateway must reach, or None if the address is a socket of the file system.

    Raises: InvalidInput for an address that one connection cannot serve.
    """
    return _parts(uri)[0]


def address_for_nodes(uri: str, folder: Path) -> str:
    """The address of the same database for nodes in namespaces, by the socket in the folder of the lab.

    Raises: InvalidInput for an address that one connection cannot serve.
    """
    server, user, database, options = _parts(uri)
    if server is None:
        return uri
    # the driver would otherwise connect to the names that the server lists, which a namespace cannot reach
    options = [one for one in options if _name(one) != "directconnection"] + ["directConnection=true"]
    return f"mongodb://{user}{quote(str(folder / SOCKET), safe='')}{database}?{'&'.join(options)}"


def _parts(uri: str) -> tuple[DatabaseServer | None, str, str, list[str]]:
    """Server, credentials, path and options of an address."""
    found = _URI.match(uri)
    hosts = found["hosts"] if found else ""
    if found is None or "," in hosts:
        raise _refusal(uri, "needs several connections", "one host, as mongodb://host:port")
    options = [one for one in re.split("[&;]", found["options"] or "") if one]
    # namespaces share the file system, so a socket needs no gateway
    if unquote(hosts).endswith(".sock"):
        return None, "", "", []
    enabled = {_name(one) for one in options if one.lower().endswith("=true")}
    # the driver would compare the certificate with the path of the socket
    if enabled & {"tls", "ssl"} and not enabled & set(_UNNAMED):
        raise _refusal(uri, "has a certificate for a name", "no TLS, or tlsAllowInvalidHostnames=true")
    try:
        where = urlsplit(f"//{hosts}")
        server = DatabaseServer(where.hostname or "", where.port or PORT)
    except ValueError as error:
        raise _refusal(uri, str(error), "mongodb://host:port") from error
    return server, found["user"] or "", found["database"] or "/", options


def _name(option: str) -> str:
    return option.partition("=")[0].lower()


def _refusal(uri: str, reason: str, expected: str) -> InvalidInput:
    shown = without_password(uri).partition("?")[0]  # options may contain secrets
    return InvalidInput(
        f"--mongodb {shown}: {reason}, and --net netns reaches a database by one local socket;"
        f" expected {expected}"
    )
