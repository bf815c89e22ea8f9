"""MCAP without chunks, compared with the reference implementation byte by byte."""

import io
from collections.abc import Sequence
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from swarmware.recorder.mcap_writer import McapWriter

TEXT = st.text(max_size=12)
MAPS = st.dictionaries(TEXT, TEXT, max_size=4)
INSTANT = st.integers(0, 2**63 - 1)
MESSAGES = st.tuples(st.integers(0, 4), st.integers(0, 2**32 - 1), INSTANT, INSTANT, st.binary(max_size=40))


@given(
    metadata=st.lists(st.tuples(TEXT, MAPS), max_size=3),
    schemas=st.lists(st.tuples(TEXT, st.binary(max_size=30)), max_size=3),
    channels=st.lists(st.tuples(TEXT, MAPS), max_size=3),
    messages=st.lists(MESSAGES, max_size=8),
)
def test_file_equals_reference_writer_byte_for_byte(
    metadata: Sequence[tuple[str, dict[str, str]]],
    schemas: Sequence[tuple[str, bytes]],
    channels: Sequence[tuple[str, dict[str, str]]],
    messages: Sequence[tuple[int, int, int, int, bytes]],
) -> None:
    ours, theirs = io.BytesIO(), io.BytesIO()
    writer = McapWriter(ours, "swarmware 1.2")
    reference: Any = Writer(theirs, use_chunking=False)
    reference.start(profile="", library="swarmware 1.2")
    for name, data in metadata:
        writer.add_metadata(name, data)
        reference.add_metadata(name, data)
    for name, body in schemas:
        assert writer.register_schema(name, body) == reference.register_schema(name, "jsonschema", body)
    for topic, data in channels:
        schema = len(schemas)
        number = writer.register_channel(schema, topic, data)
        assert number == reference.register_channel(topic, "msgpack", schema, data)
    for channel, sequence, log_ns, publish_ns, body in messages:
        writer.add_message(channel, sequence, log_ns, publish_ns, body)
        reference.add_message(channel, log_ns, body, publish_ns, sequence)
    writer.finish()
    reference.finish()
    assert ours.getvalue() == theirs.getvalue()


def test_foreign_tools_find_messages_by_summary() -> None:
    out = io.BytesIO()
    writer = McapWriter(out, "swarmware 1.2")
    channel = writer.register_channel(writer.register_schema("Text", b"{}"), "/uav1/note", {"kind": "board"})
    writer.add_message(channel, 7, 20, 10, b"one")
    writer.add_message(channel, 8, 15, 11, b"two")
    writer.finish()
    out.seek(0)
    reader = make_reader(out)
    summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (15, 20)
    found = [(s.name, c.topic, m.sequence, m.data) for s, c, m in reader.iter_messages() if s is not None]
    assert found == [("Text", "/uav1/note", 8, b"two"), ("Text", "/uav1/note", 7, b"one")]
