"""Recorded types whose names look like schemas of Foxglove: only a shipped schema is read for them."""

import io
import os
from pathlib import Path

import pytest

from swarmctl.viewers.mcap_export import write_mcap
from swarmware.model.config import share_dir
from swarmware.recorder.entry import LogEntry

SCHEMAS = share_dir() / "schemas/foxglove"


def exported(type_name: str) -> bytes:
    """The MCAP file of one entry of this type."""
    file = io.BytesIO()
    assert (
        write_mcap(
            [LogEntry("uav1:x:out", 1, "uav1", "x/y", "event", type_name, 1, 2, b"\x91\x07")], file, {}
        )
        == 1
    )
    return file.getvalue()


def test_recorded_type_name_leaves_no_folder(tmp_path: Path) -> None:
    secret = tmp_path / "secret.json"
    secret.write_text('{"title": "a secret"}')
    for way in (os.path.relpath(secret, SCHEMAS), str(secret)):
        assert b"a secret" not in exported(f"foxglove.{way.removesuffix('.json')}")


@pytest.mark.parametrize("name", ["foxglove.Nothing", "foxglove.", "foxglove.LICENSE"])
def test_recorded_type_without_schema_is_exported(name: str) -> None:
    assert name.encode() in exported(name)


def test_a_shipped_schema_is_in_the_file() -> None:
    assert b"timestamp" in exported("foxglove.Log")
