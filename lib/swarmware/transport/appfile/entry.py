"""Content of an application file, and its encoding."""

import zlib
from typing import Any, Final, Literal

import msgspec
import tomli_w

from swarmware.errors import ConfigError, WireError
from swarmware.model import document, names
from swarmware.model.resource import Plain, Resource
from swarmware.runtime.pidfd import lives

_MARK: Final = "# crc32 "
"""Mark of the last line: the file is rewritten in place, and a reader must detect a partial one."""
FILE_LIMIT: Final = 256 << 10
"""Maximum bytes of an application file; the largest of a daemon has 6 kB, each type of its own adds some
hundred."""


class Served(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """An address of the application for messages, requests or datagrams."""

    path: str
    """Local path of the address."""
    type: str
    """Name of the payload type."""
    kind: Literal["message", "request", "datagram"]

    @property
    def data_id(self) -> int:
        """Id in frame headers."""
        return names.data_id(self.path, self.type)


class AppEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One application that runs on this node."""

    name: str
    instance: int
    pid: int
    pid_start: int
    """Start of the process in clock ticks since boot: distinguishes processes with the same pid."""
    endpoint: str
    """Address of the message socket of its process: `ipc://<path>`."""
    started_ns: int
    """Node's hardware clock when the application joined."""
    provides: tuple[Resource, ...] = ()
    serves: tuple[Served, ...] = ()
    reads: tuple[str, ...] = ()
    """Paths and patterns of other platforms' resources that it subscribes to."""
    needs: dict[str, float] = {}
    """Longest delay in seconds, from stamp to arrival, with which it can use a resource that it reads."""
    types: dict[str, str] = {}
    """Descriptions of the payload types that it defines itself, by name: JSON of a `TypeDescription`."""
    config: dict[str, Any] = {}
    """Configuration of the service by its file and the defaults, as TOML values."""
    live: dict[str, str] = {}
    """Keys of `config`, dotted, and the keys of the live settings that override them."""
    applied: dict[str, Plain] = {}
    """Values of live settings that it has taken since it joined, by the key of the setting."""

    @property
    def id(self) -> str:
        """Name and instance of the application: `name#instance`."""
        return f"{self.name}#{self.instance}"

    @property
    def lives(self) -> bool:
        """Whether its process still runs, as far as this PID namespace can see.

        A locked file does not prove that: the next process of the application, the master that moves the file
        aside, and processes that look for a dead guard lock the file of a dead one for a moment.
        """
        return lives(self.pid, self.pid_start)

    @property
    def app_id(self) -> int:
        """Id in frame headers."""
        return names.application_id(self.name, self.instance)


def encode(entry: AppEntry) -> bytes:
    """Encode the content of the file."""
    text = tomli_w.dumps(_plain(msgspec.to_builtins(entry)))
    return f"{text}{_MARK}{zlib.crc32(text.encode()):08x}\n".encode()


def decode(data: bytes, source: str, *, whole: bool = True) -> AppEntry:
    """Decode the content of a file; not `whole`: as far as messages need it, to `serves`.

    Raises: WireError when it is incomplete or not an application file.
    """
    try:
        # the last mark: a value of the file may contain the same text
        text, mark, check = data.decode().rpartition(_MARK)
        if mark and int(check, 16) == zlib.crc32(text.encode()):
            # after the checksum, which covers the whole text
            if not whole and (head := _head(text, source)) is not None:
                return head
            # a configuration may have infinite numbers, which TOML permits
            return msgspec.convert(document.toml(text, source, finite=False), AppEntry)
    except (ValueError, msgspec.ValidationError) as error:
        raise WireError(f"{source}: not an application file: {error}") from error
    raise WireError(f"{source}: incomplete; expected a last line with the checksum of the others")


def _head(text: str, source: str) -> AppEntry | None:
    """The keys before the first table, which TOML has first, or None if `serves` is not among them.

    They are a third of the text, whose parsing takes most of the time in which a client joins.
    """
    try:
        found = document.toml(text.partition("\n[")[0], source, finite=False)
    except ConfigError:
        return None  # the line that begins with [ belongs to a value, not to a table
    return msgspec.convert(found, AppEntry) if "serves" in found else None


def _plain(value: Any) -> Any:
    """The value without None, which TOML cannot represent."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value if item is not None]
    return value
