"""Folders that a cleaner of temporary files must leave alone are locked, by one process each."""

import shutil
from pathlib import Path

from tests.unit.service.folders import is_left_alone

from swarmd.kept_folders import KeptFolders


def test_each_folder_is_locked_until_the_end(tmp_path: Path) -> None:
    folders = [tmp_path / "run", tmp_path / "lab"]
    for folder in folders:
        folder.mkdir()
    kept = KeptFolders([*map(str, folders), str(tmp_path / "missing")])
    assert all(map(is_left_alone, folders))
    kept.close()
    assert not any(map(is_left_alone, folders))
    kept.close()


def test_folder_that_is_made_again_is_locked_again(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    kept = KeptFolders([str(folder)])
    shutil.rmtree(folder)
    kept.relock()
    folder.mkdir()
    assert not is_left_alone(folder)
    kept.relock()
    assert is_left_alone(folder)
    kept.close()


def test_other_lab_node_keeps_folder_after_first(tmp_path: Path) -> None:
    first, second = KeptFolders([str(tmp_path)]), KeptFolders([str(tmp_path)])
    second.relock()
    first.close()
    assert not is_left_alone(tmp_path)
    second.relock()
    assert is_left_alone(tmp_path)
    second.close()
