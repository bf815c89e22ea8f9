"""Entry points of installed packages, read as `importlib.metadata` reads them."""

import importlib.metadata
import sys
from pathlib import Path

import pytest

from swarmware.footprint.entry_points import EntryPoint, entry_points, none_is_foreign

GROUPS = ("swarmware.services", "console_scripts", "pytest11", "swarmware.nosuch")


def package(folder: Path, name: str, text: str) -> None:
    info = folder / name
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name.partition('-')[0]}\nVersion: 1\n")
    (info / "entry_points.txt").write_text(text)


def by_the_standard_library(group: str) -> list[tuple[str, str]]:
    found = importlib.metadata.entry_points(group=group)
    return sorted((point.name, point.value.partition("[")[0].strip()) for point in found)


@pytest.mark.parametrize("group", GROUPS)
def test_installed_entry_points_are_those_of_standard_library(group: str) -> None:
    assert sorted((point.name, point.value) for point in entry_points(group)) == by_the_standard_library(
        group
    )


def test_comments_extras_and_other_groups_are_distinguished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "# a comment\n[swarmware.drivers]\n lidar = pkg.mod:make [fast] \n\n[other]\nlidar=x:y\n"
    package(tmp_path / "site", "pkg-1.0.dist-info", text)
    monkeypatch.setattr(sys, "path", [str(tmp_path / "site"), str(tmp_path / "nosuch"), *sys.path])
    found = [point for point in entry_points("swarmware.drivers") if point.name == "lidar"]
    assert found == [EntryPoint("lidar", "pkg.mod:make", "swarmware.drivers")]
    assert by_the_standard_library("swarmware.drivers") == [("lidar", "pkg.mod:make")]


def test_first_of_two_versions_on_path_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder, value in (("first", "new:make"), ("second", "old:make")):
        package(tmp_path / folder, "My_Pkg-1.0.dist-info", f"[swarmware.drivers]\nlidar = {value}\n")
    monkeypatch.setattr(sys, "path", [str(tmp_path / "first"), str(tmp_path / "second"), *sys.path])
    assert [point.value for point in entry_points("swarmware.drivers")] == ["new:make"]


def test_entry_point_loads_nested_object_and_module() -> None:
    assert EntryPoint("x", "pathlib:Path.home", "g").load() == Path.home
    assert EntryPoint("x", "pathlib", "g").load() is sys.modules["pathlib"]
    with pytest.raises(ModuleNotFoundError, match="nosuch"):
        EntryPoint("x", "nosuch.module:thing", "g").load()


@pytest.mark.parametrize("group", ["services", "drivers", "blocks"])
def test_a_plugin_of_another_package_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, group: str
) -> None:
    assert none_is_foreign()
    package(tmp_path, "theirs-1.0.dist-info", f"[swarmware.{group}]\nthing = theirs:Thing\n")
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    assert not none_is_foreign()
