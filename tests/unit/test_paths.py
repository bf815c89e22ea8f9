"""Derived paths: what follows from a name is a valid resource path, and files are where the page says."""

import re
from pathlib import Path

import pytest

from swarmware.model import paths
from swarmware.model.names import check_application, check_path

PAGE = (Path(__file__).parents[2] / "share/doc/protocol.md").read_text()


@pytest.mark.parametrize("name", ["planner", "my-planner", "a1", "x" * 20])
def test_every_application_name_has_valid_resource_paths(name: str) -> None:
    check_application(name)
    for path in (paths.status(name), paths.checks(name, 1), paths.checks(name, 2)):
        assert check_path(path) == path
    assert "-" not in paths.status(name)
    assert paths.checks(name, 1) != paths.checks(name, 2)


def test_page_of_protocol_names_same_places() -> None:
    run, shm = Path("<run_dir>"), Path("<shm_dir>")
    places = [
        paths.applications(run),
        paths.sockets(run),
        paths.doorbells(run),
        paths.applications_watchers(shm),
        paths.mirrors_watchers(shm),
        paths.master_watchers(shm),
    ]
    missing = [str(place) for place in places if not re.search(re.escape(str(place)) + r"\b", PAGE)]
    assert not missing


def test_file_is_in_folder_of_its_kind(tmp_path: Path) -> None:
    assert paths.socket(tmp_path, "17-0").parent == paths.sockets(tmp_path)
    assert paths.socket(tmp_path, "17-0").match(paths.SOCKET_PATTERN)
