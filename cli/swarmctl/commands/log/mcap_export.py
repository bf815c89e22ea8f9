"""Entries as an MCAP file for viewers: JSON messages with schemas, chunks and an index."""

from collections.abc import Iterable, Mapping
from typing import Any, BinaryIO

import msgspec

from swarmctl.commands.log.panels import panel_messages
from swarmctl.commands.log.viewer_form import viewer_schema, viewer_value
from swarmware import __version__
from swarmware.geometry.geodesy import LocalMap, Origin
from swarmware.model.config import share_dir
from swarmware.model.file_name import is_file_name
from swarmware.recorder.entry import LogEntry, list_or_none


def write_mcap(entries: Iterable[LogEntry], file: BinaryIO, origins: Mapping[str, Origin]) -> int:
    """Writes each entry on its topic, and what panels show below `/foxglove`; the number of entries.

    `origins`: of the maps of the platforms; poses of others are not on the map panel.
    """
    from mcap.writer import Writer

    writer: Any = Writer(file)
    writer.start(profile="", library=f"swarmware {__version__}")
    topics = _Topics(writer)
    maps = {platform: LocalMap(origin) for platform, origin in origins.items()}
    count = 0
    for entry in entries:
        sent_ns = max(0, entry.sent_utc_ns or entry.utc_ns)
        value = entry.value()
        content = viewer_value(value if value is not None else list_or_none(entry.payload))
        sent = {"log_time": entry.utc_ns, "publish_time": sent_ns, "sequence": entry.sequence & 0xFFFFFFFF}
        channel = topics.channel(entry.topic, entry.type, entry.description)
        writer.add_message(channel, data=msgspec.json.encode(content), **sent)
        for message in panel_messages(entry, maps.get(entry.platform)):
            channel = topics.channel(message.topic, message.schema)
            writer.add_message(channel, data=msgspec.json.encode(message.content), **sent)
        count += 1
    writer.finish()
    return count


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
