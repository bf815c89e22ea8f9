"""A ring that is not there yet."""

from pathlib import Path

from swarmware.transport.shm.ringfile import absent


def test_reader_waits_silently_only_without_file(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("nowhere")
    found = {name: absent(str(tmp_path / name)) for name in ("file", "link", "file/below", "none", "no/none")}
    assert found == {"file": False, "link": False, "file/below": False, "none": True, "no/none": True}
