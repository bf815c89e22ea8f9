"""Logs of other programs: refused by their name, never counted as damage."""

import io
from pathlib import Path
from typing import Any

import msgpack
import pytest
from mcap.writer import CompressionType, Writer

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.log.entries import folders
from swarmware.errors import InvalidInput, NotFound
from swarmware.recorder.foreign_log import foreign_log
from swarmware.recorder.query import FolderSource, Query
from swarmware.recorder.ring import LogRing, segments
from swarmware.recorder.segment import LogChannel
from swarmware.recorder.spool import SpoolSource
from swarmware.types import registry
from swarmware.types.scalar import Text

UTC = 1_700_000_000_000_000_000


def own(directory: Path, count: int = 20) -> None:
    ring = LogRing(directory, segment_bytes=2000, min_free_bytes=0)
    note = LogChannel("uav1", "mission/note", "event", "Text", "uav1:mission:out")
    for number in range(1, count + 1):
        ring.append(note, number, UTC + number, registry.encode(Text(f"{number}")))
    ring.flush()
    ring.close()


def foreign(
    path: Path, encoding: str = "cdr", library: str = "rosbag2", *, chunks: CompressionType | None = None
) -> None:
    with path.open("wb") as file:
        compression = CompressionType.NONE if chunks is None else chunks
        writer: Any = Writer(file, compression=compression, use_chunking=chunks is not None)
        writer.start(profile="ros2", library=library)
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/chatter", encoding, schema)
        for number in range(50):
            writer.add_message(channel, number, b"\x00\x01\x00\x00hello", number)
        writer.finish()


@pytest.mark.parametrize("chunks", [CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE])
def test_a_log_with_chunks_is_named(tmp_path: Path, chunks: CompressionType) -> None:
    foreign(tmp_path / "1.mcap", "msgpack", "mcap go v1.4", chunks=chunks)
    assert foreign_log(tmp_path / "1.mcap") == "an MCAP file with compressed chunks, of mcap go v1.4"


@pytest.mark.parametrize(
    ("encoding", "library", "what"),
    [
        ("cdr", "rosbag2", "an MCAP file with channels of another program (rosbag2, cdr)"),
        ("json", "", "an MCAP file with channels of another program (unnamed, json)"),
        ("json", "swarmware 0.2", "an MCAP file for viewers, of `swarmctl log export --format mcap`"),
        ("msgpack", "another", ""),
    ],
)
def test_channels_of_another_program_are_named(
    tmp_path: Path, encoding: str, library: str, what: str
) -> None:
    foreign(tmp_path / "1.mcap", encoding, library)
    assert foreign_log(tmp_path / "1.mcap") == what


def test_own_segments_are_own_whole_growing_or_damaged(tmp_path: Path) -> None:
    own(tmp_path)
    for path in segments(tmp_path):
        data = path.read_bytes()
        for cut in range(0, len(data), 7):
            path.write_bytes(data[:cut])
            assert foreign_log(path) == ""
        for at in range(0, 300, 3):
            path.write_bytes(data[:at] + bytes([data[at] ^ 0x55]) + data[at + 1 :])
            assert "chunks" not in foreign_log(path)
        path.write_bytes(data)
        assert foreign_log(path) == ""


@pytest.mark.parametrize("name", ["1.mcap", "rosbag2_2026_0.mcap"])
def test_folder_of_another_program_is_refused_by_name(tmp_path: Path, name: str) -> None:
    foreign(tmp_path / name, chunks=CompressionType.ZSTD)
    with pytest.raises(InvalidInput, match=f"{name}: an MCAP file with compressed chunks") as found:
        FolderSource([tmp_path]).entries(Query())
    assert found.value.exit_code == 7


@pytest.mark.parametrize(
    ("name", "content", "what"),
    [
        ("flight.ulg", b"ULog\x01\x12\x35\x01", "ULog"),
        ("a_0.db3", b"SQLite format 3\0", "rosbag2"),
        ("a.bag", b"#ROSBAG V2.0\n", "rosbag"),
        ("metadata.yaml", b"rosbag2_bagfile_information:\n", "rosbag2"),
    ],
)
def test_foreign_log_is_refused_as_folder_and_stream(
    tmp_path: Path, name: str, content: bytes, what: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content + bytes(100))
    with pytest.raises(InvalidInput, match=f"{name}: .*{what}.*expected a folder with"):
        FolderSource([path])
    with pytest.raises(InvalidInput, match=f"{name}: .*{what}"):
        FolderSource([tmp_path]).entries(Query())
    with path.open("rb") as file, pytest.raises(InvalidInput, match=f"{what}.*expected MessagePack of"):
        list(SpoolSource(file, name).entries(Query()))


def test_a_segment_as_a_stream_is_named(tmp_path: Path) -> None:
    own(tmp_path)
    (path, *_) = segments(tmp_path)
    with path.open("rb") as file, pytest.raises(InvalidInput, match="a log of MCAP"):
        list(SpoolSource(file, "log").entries(Query()))


def test_foreign_file_between_segments_is_loss_not_damage(tmp_path: Path) -> None:
    own(tmp_path)
    foreign(tmp_path / "99999999.mcap")
    for query in (Query(), Query(newest=True, limit=20)):
        source = FolderSource([tmp_path])
        assert len(list(source.entries(query))) == 20
        (loss,) = source.losses()
        assert "99999999.mcap: an MCAP file with channels of another program" in loss
        assert "damaged" not in loss


def test_a_folder_without_a_log_says_so(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("nothing")
    (tmp_path / "folder").mkdir()
    source = FolderSource([tmp_path])
    assert list(source.entries(Query())) == []
    assert "nothing is recorded" in source.why_empty()


def test_stream_of_any_length_is_read() -> None:
    values = [{"number": number, "text": "x" * 90} for number in range(500)]
    packed = b"".join(msgpack.packb(value) for value in values)
    found = list(SpoolSource(io.BytesIO(packed), "a").entries(Query()))
    assert [msgpack.unpackb(entry.payload) for entry in found] == values


def test_the_command_names_a_log_of_another_program(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    path = tmp_path / "flight.ulg"
    path.write_bytes(b"ULog\x01\x12\x35\x01")
    for place in (path, tmp_path):
        with pytest.raises(InvalidInput, match=r"flight\.ulg: a flight log of PX4 \(ULog\): not"):
            folders(CliSettings(), str(place))
    with pytest.raises(NotFound, match="no segments"):
        folders(CliSettings(), str(tmp_path / "deep"))
