"""`swarmctl new`: what is made, and what is refused with nothing made."""

import json
from pathlib import Path

import pytest

from swarmctl.commands.new.scaffold import CLASS_NAME, KINDS, NAME, write_files
from swarmctl.main import main as swarmctl
from swarmware.model.config import share_dir

SCAFFOLDS = share_dir() / "scaffolds"


def test_each_kind_has_scaffold_and_each_scaffold_kind() -> None:
    assert {path.name for path in SCAFFOLDS.iterdir()} == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_folder_has_readme_test_and_new_name(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert swarmctl(["new", kind, "deep_sonar", "--dir", str(tmp_path)]) == 0
    made = tmp_path / "deep_sonar"
    files = sorted(path for path in made.rglob("*") if path.is_file())
    out, err = capsys.readouterr()
    assert sorted(out.splitlines()) == [str(path) for path in files]
    assert err == f"test it: cd {made} && {KINDS[kind].test}\n"
    assert made / "README.md" in files
    texts = [f"{path.relative_to(made)}\n{path.read_text()}" for path in files]
    assert not [text for text in texts if NAME in text or CLASS_NAME in text]
    assert all("deep_sonar" in text for text in texts)


@pytest.mark.parametrize("kind", KINDS)
def test_document_names_folder_its_files_and_its_test(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert swarmctl(["new", kind, "deep_sonar", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["kind"], document["name"]) == (kind, "deep_sonar")
    assert document["path"] == str(tmp_path / "deep_sonar")
    assert all((tmp_path / "deep_sonar" / path).is_file() for path in document["files"])
    assert document["test"].startswith("cd deep_sonar && ")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "name", ["", "Sonar", "1sonar", "_sonar", "so-nar", "so nar", "../sonar", "s" * 32, "söner", "sonar\n"]
)
def test_invalid_name_is_refused_with_allowed_form(
    kind: str, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert swarmctl(["new", kind, "--dir", str(tmp_path), "--", name]) == 7
    error = capsys.readouterr().err
    assert f"name {name!r} of a {kind}: expected [a-z][a-z0-9_]{{0,30}}, such as" in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("kind", "name", "code", "text"),
    [
        ("module", "class", 7, "a word of Python"),
        ("module", "json", 1, "the Python module"),
        ("driver", "swarmware", 1, "the Python module"),
        ("driver", "sim", 1, "the driver of swarmware has it"),
        ("block", "land", 1, "a block type Land is installed"),
        ("service", "broker", 1, "the service of swarmd.broker.service:Broker has it"),
    ],
)
def test_a_name_that_would_hide_another_is_refused(
    kind: str, name: str, code: int, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert swarmctl(["new", kind, name, "--dir", str(tmp_path)]) == code
    assert text in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("what", ["folder", "file", "dangling link"])
def test_what_exists_is_left_as_it_is(what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = tmp_path / "sonar"
    match what:
        case "folder":
            place.mkdir()
        case "file":
            place.write_text("mine")
        case _:
            place.symlink_to(tmp_path / "nosuch")
    assert swarmctl(["new", "driver", "sonar", "--dir", str(tmp_path)]) == 1
    assert f"{place}: exists; expected a new name" in capsys.readouterr().err
    assert list(tmp_path.rglob("*")) == [place]


def test_a_parent_that_is_missing_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert swarmctl(["new", "module", "sonar", "--dir", str(tmp_path / "nosuch")]) == 6
    assert f"folder {tmp_path / 'nosuch'}: not found" in capsys.readouterr().err


def test_an_installation_without_scaffolds_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "share/templates").mkdir(parents=True)
    monkeypatch.setenv("SWARM_SHARE", str(tmp_path / "share"))
    assert swarmctl(["new", "module", "sonar", "--dir", str(tmp_path)]) == 6
    assert f"scaffold {tmp_path / 'share/scaffolds/module'}: not found" in capsys.readouterr().err
    assert not (tmp_path / "sonar").exists()


def test_a_folder_that_cannot_be_completed_is_removed(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="File name too long"):
        write_files(tmp_path / "sonar", {"README.md": "", "x" * 300: ""})
    assert list(tmp_path.iterdir()) == []
