"""The folder of the files of a node."""

import os
from pathlib import Path

import msgspec
import pytest

from swarmd.files.store import FileStore
from swarmware.errors import NotFound
from swarmware.footprint.blake2b import blake2b
from swarmware.transport.transfer.block_set import BLOCK_BYTES
from swarmware.types.bounds import FileName
from swarmware.types.file import FileOffer

CONTENT = b"x" * (BLOCK_BYTES + 1)
OFFER = FileOffer("map.png", len(CONTENT), blake2b(CONTENT, digest_size=32).digest())


def stored(tmp_path: Path) -> FileStore:
    store = FileStore(tmp_path / "files")
    part = store.part(OFFER)
    part.write(0, CONTENT[:BLOCK_BYTES])
    part.write(BLOCK_BYTES, CONTENT[BLOCK_BYTES:])
    store.finish(OFFER)
    return store


def test_stored_file_is_listed_and_read_in_blocks(tmp_path: Path) -> None:
    store = stored(tmp_path)
    assert [(one.name, one.size_bytes) for one in store.entries()] == [("map.png", len(CONTENT))]
    assert store.stored_bytes() == len(CONTENT)
    assert store.entry("map.png").digest == OFFER.digest
    assert store.has_content("map.png", OFFER.digest)
    assert store.read("map.png", 0) + store.read("map.png", BLOCK_BYTES) == CONTENT


def test_a_changed_file_has_another_digest(tmp_path: Path) -> None:
    store = stored(tmp_path)
    assert store.has_content("map.png", OFFER.digest)
    (store.folder / "map.png").write_bytes(b"other")
    assert not store.has_content("map.png", OFFER.digest)


def test_incomplete_files_and_links_are_hidden(tmp_path: Path) -> None:
    store = stored(tmp_path)
    store.part(FileOffer("new.png", 5, bytes(32)))
    (tmp_path / "secret").write_text("secret")
    (store.folder / "link").symlink_to(tmp_path / "secret")
    assert [one.name for one in store.entries()] == ["map.png"]
    with pytest.raises(NotFound):
        store.read("link", 0)
    with pytest.raises(NotFound):
        store.entry("link")
    with pytest.raises(NotFound, match="swarmctl file ls"):
        store.entry("gone")
    store.close()


@pytest.mark.parametrize(
    "name", ["../secret", "a/b", ".hidden", "", "a" * 101, "..", "a\n", "/etc/passwd", "a\0"]
)
def test_name_outside_folder_is_no_file_name(name: str) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.msgpack.decode(msgspec.msgpack.encode((name, 1, bytes(32))), type=FileOffer)


def test_ordinary_names_are_file_names() -> None:
    for name in ("map.png", "log_2026-11-23.mcap", "a+b", "9"):
        assert msgspec.convert(name, FileName) == name


def test_what_nobody_continued_is_removed_at_the_start(tmp_path: Path) -> None:
    store = FileStore(tmp_path)
    store.part(OFFER)
    store.close()
    [part] = tmp_path.glob(".*.part")
    assert store.remove_old(part.stat().st_mtime - 1) == 0
    os.utime(part, (100, 100))
    assert store.remove_old(200) == 1
    assert list(tmp_path.iterdir()) == []


def test_refused_file_leaves_nothing_when_it_is_discarded(tmp_path: Path) -> None:
    store = FileStore(tmp_path)
    store.part(OFFER)
    store.drop(OFFER.digest, discard=True)
    assert list(tmp_path.iterdir()) == []
