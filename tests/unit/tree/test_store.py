"""Settings on disk: replaced whole, kept aside when broken, unchanged when they cannot be written."""

import errno
import logging
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swarmd.tree.settings.store import SIZE_LIMIT, SettingsStore
from swarmware.model.resource import Plain
from swarmware.model.stored_setting import HISTORY_LIMIT, SettingChange, StoredSetting


def change(after: Plain, before: Plain, **more: Any) -> SettingChange:
    return SettingChange(utc_ns=1, by="operator@gcs", before=before, after=after, **more)


def test_what_was_kept_is_there_after_a_start(tmp_path: Path) -> None:
    path = tmp_path / "data" / "settings.toml"
    store = SettingsStore(path)
    assert store.get("config/a") is None
    store.put("config/a", change(2.5, 1.0))
    store.put("config/a", change(3.5, 2.5))
    store.put("config/b", change("text", ""))
    again = SettingsStore(path)
    kept = again.get("config/a")
    assert kept is not None
    assert (kept.value, kept.version) == (3.5, 2)
    assert kept.history == (change(2.5, 1.0), change(3.5, 2.5))
    assert [path for path, _ in again] == ["config/a", "config/b"]
    assert [file.name for file in path.parent.iterdir()] == ["settings.toml"]


@pytest.mark.parametrize("value", [1, 1.5, True, "text", "", -0.0, 1e300])
def test_every_plain_value_keeps_its_type(tmp_path: Path, value: bool | int | float | str) -> None:
    path = tmp_path / "settings.toml"
    SettingsStore(path).put("config/a", change(value, value))
    kept = SettingsStore(path).get("config/a")
    assert kept is not None
    assert kept.value == value
    assert type(kept.value) is type(value)


@pytest.mark.parametrize(
    "content", [b"nonsense [", b"\xff\xfe", b'["config/a"]\nvalue = [1]\nversion = 1\n', b"a = 1"]
)
def test_a_broken_file_is_kept_aside_and_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, content: bytes
) -> None:
    path = tmp_path / "settings.toml"
    path.write_bytes(content)
    with caplog.at_level(logging.ERROR):
        store = SettingsStore(path)
    assert store.get("config/a") is None
    (aside,) = tmp_path.iterdir()
    assert aside.read_bytes() == content
    assert aside.name in caplog.text
    store.put("config/a", change(1.0, 0.0))
    assert SettingsStore(path).get("config/a") is not None


def test_what_cannot_be_written_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "settings.toml"
    store = SettingsStore(path)
    store.put("config/a", change(1.0, 0.0))
    (tmp_path / f".settings.toml.{os.getpid()}").mkdir()
    with pytest.raises(OSError, match="directory"):
        store.put("config/a", change(2.0, 1.0))
    for one in (store, SettingsStore(path)):
        kept = one.get("config/a")
        assert kept is not None
        assert kept.value == 1.0


@pytest.mark.parametrize("call", ["open", "fsync", "replace"])
def test_full_disk_refuses_setting_and_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    path = tmp_path / "settings.toml"
    store = SettingsStore(path)
    store.put("config/a", change(1.0, 0.0))

    def no_room(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        match call:
            case "replace":
                patch.setattr(Path, call, no_room)
            case _:
                patch.setattr(os, call, no_room)
        with pytest.raises(OSError, match="No space"):
            store.put("config/a", change(2.0, 1.0))
    assert [file.name for file in tmp_path.iterdir()] == ["settings.toml"]
    for one in (store, SettingsStore(path)):
        assert one.get("config/a") == StoredSetting(value=1.0, version=1, history=(change(1.0, 0.0),))
    assert store.put("config/a", change(2.0, 1.0)).version == 2


def test_change_to_value_of_file_is_no_override(tmp_path: Path) -> None:
    path = tmp_path / "settings.toml"
    store = SettingsStore(path)
    store.put("config/a", change(2.0, 1.0, overrode=False))
    store.put("config/a", change(1.0, 2.0, overrides=False))
    for one in (store, SettingsStore(path)):
        kept = one.get("config/a")
        assert kept is not None
        assert (kept.value, kept.version) == (None, 2)
        assert [(c.overrode, c.overrides) for c in kept.history] == [(False, True), (True, False)]


def test_the_history_of_a_setting_is_bounded(tmp_path: Path) -> None:
    path = tmp_path / "settings.toml"
    store = SettingsStore(path)
    for number in range(HISTORY_LIMIT + 3):
        store.put("config/a", change(number + 1, number))
    kept = SettingsStore(path).get("config/a")
    assert kept is not None
    assert kept.version == HISTORY_LIMIT + 3
    assert [one.before for one in kept.history] == list(range(3, HISTORY_LIMIT + 3))


def test_long_histories_shorten_before_file_overflows(tmp_path: Path) -> None:
    path = tmp_path / "settings.toml"
    store = SettingsStore(path)
    for number in range(12):
        for name in ("config/a", "config/b"):
            store.put(name, change(f"{number:060000}", f"{number - 1:060000}"))
            assert path.stat().st_size <= SIZE_LIMIT
    again = SettingsStore(path)
    for one in (store, again):
        for _, kept in one:
            assert (kept.value, kept.version) == (f"{11:060000}", 12)
            assert kept.history[-1].before == f"{10:060000}", "the last change may be undone"


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.one_of(st.binary(max_size=60), st.text(max_size=60).map(str.encode)))
def test_any_content_is_settings_or_kept_aside(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "settings.toml"
    path.write_bytes(content)
    SettingsStore(path)
    for file in tmp_path.iterdir():
        file.unlink()
