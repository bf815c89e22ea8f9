"""Entries as an MCAP file for viewers: JSON messages with schemas, chunks and an index."""

from collections.abc import Iterable, Mapping
from typing import Any, BinaryIO, Final

import msgspec

from swarmctl.viewers.lost_values import LostValues
from swarmctl.viewers.panels import panel_messages
from swarmctl.viewers.viewer_form import viewer_schema, viewer_value
from swarmware import __version__
from swarmware.geometry.geodesy import LocalMap, Origin
from swarmware.model.config import share_dir
from swarmware.recorder.entry import LogEntry
from swarmware.types.bounds import is_file_name

_TIME_LIMIT: Final = (1 << 64) - 1
"""Newest time of a message. Source: MCAP specification, Timestamp."""


class ByteStream:
    """What the library writes to: it asks for the position, which a pipe does not know."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._written = 0

    def write(self, data: bytes | bytearray | memoryview, /) -> int:
        """Write the data, and count its bytes."""
        self._file.write(data)
        self._written += len(data)
        return len(data)

    def tell(self) -> int:
        """Bytes written so far."""
        return self._written

    def flush(self) -> None:
        """Flush the buffer of the file."""
        self._file.flush()


def write_mcap(
    entries: Iterable[LogEntry], file: BinaryIO, origins: Mapping[str, Origin], lost: LostValues | None = None
) -> int:
    """Writes each entry on its topic, and what panels show below `/foxglove`; the number of entries.

    `origins`: of the maps of the platforms; poses of others are not on the map panel.
    MCAP has no times before 1970: they are 0.
    """
    from mcap.writer import Writer

    lost = LostValues() if lost is None else lost
    stream: Any = ByteStream(file)  # the library uses no other method
    writer: Any = Writer(stream)
    writer.start(profile="", library=f"swarmware {__version__}")
    topics = _Topics(writer)
    maps = {platform: LocalMap(origin) for platform, origin in origins.items()}
    count = 0
    for entry in entries:
        try:
            content = viewer_value(entry.content())
        except RecursionError:
            lost.add(f"{entry.type or 'value'}, nested too deep")
            # the message stays, with its time and sequence
            content = {}
        sent = {
            "log_time": _time(entry.utc_ns),
            "publish_time": _time(entry.sent_utc_ns or entry.utc_ns),
            # a sequence of MCAP has 32 bits
            "sequence": entry.sequence & 0xFFFFFFFF,
        }
        channel = topics.channel(entry.topic, entry.type, entry.description)
        writer.add_message(channel, data=msgspec.json.encode(content), **sent)
        for message in panel_messages(entry, maps.get(entry.platform)):
            channel = topics.channel(message.topic, message.schema)
            writer.add_message(channel, data=msgspec.json.encode(message.content), **sent)
        count += 1
    writer.finish()
    return count


def _time(utc_ns: int) -> int:
    return min(max(0, utc_ns), _TIME_LIMIT)


class _Topics:
    """Numbers of the channels and schemas that are written."""

    def __init__(self, writer: Any) -> None:
        self._writer = writer
        self._schemas: dict[tuple[str, str], int] = {}
        self._channels: dict[tuple[str, str, str], int] = {}

    def channel(self, topic: str, schema: str, description: str = "") -> int:
        """Channel of a topic with messages of this schema: a recorded type, or one of Foxglove's."""
        key = topic, schema, description
        found = self._channels.get(key)
        if found is None:
            found = self._writer.register_channel(topic, "json", self._schema(schema, description))
            self._channels[key] = found
        return found

    def _schema(self, name: str, description: str) -> int:
        key = name, description
        if key not in self._schemas:
            file = f"{name.removeprefix('foxglove.')}.json"
            path = share_dir() / "schemas" / "foxglove" / file
            # a recorded type may have any name, also one of Foxglove's with folders in it
            if name.startswith("foxglove.") and is_file_name(file) and path.is_file():
                data = path.read_bytes()
            else:
                data = msgspec.json.encode(viewer_schema(name, description))
            self._schemas[key] = self._writer.register_schema(name or "unknown", "jsonschema", data)
        return self._schemas[key]
