"""`swarmctl log` reads the requested database, or by default the database that the logs are forwarded to."""

import stat
from pathlib import Path

import pytest

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.config.keys import local_keys
from swarmctl.commands.doctor import checks
from swarmctl.commands.log import entries
from swarmctl.session import labs
from swarmlab.provision.provisioning import LabSpec, make, remove
from swarmware.errors import NotFound, Partial
from swarmware.model.config import load_service
from swarmware.recorder.query import FolderSource, Query
from swarmware.testing.tmpnode import make_node

URI = "mongodb://swarm:s3cret@127.0.0.1:1"


def node(tmp_path: Path, **logger: object) -> CliSettings:
    return CliSettings(config=str(make_node(tmp_path, services={"logger": logger})))


@pytest.mark.parametrize(
    ("asked", "database", "expected"),
    [
        ("mongodb://h", "", ("mongodb://h", "swarm_field")),
        ("mongodb://h/other?x=1", "", ("mongodb://h/other?x=1", "other")),
        ("mongodb://h/other", "mine", ("mongodb://h/other", "mine")),
        ("-", "", (URI, "swarm_field")),
    ],
)
def test_the_database_of_the_node_is_the_default(
    tmp_path: Path, asked: str, database: str, expected: tuple[str, str]
) -> None:
    settings = node(tmp_path, mongodb_uri=URI, mongodb_database="swarm_field")
    assert entries.database(settings, asked, database) == expected


def test_node_without_forwarding_has_no_database(tmp_path: Path) -> None:
    settings = node(tmp_path)
    assert entries.database(settings, "mongodb://h", "") == ("mongodb://h", "swarm")
    with pytest.raises(NotFound, match="the logs are not forwarded"):
        entries.database(settings, "-", "")


def test_lab_database_is_recorded_and_files_are_private(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.setenv("SWARMCTL_LABS", str(tmp_path))
    lab = make(LabSpec(experiment="formation", nodes=3, seed=1, name="field", mongodb_uri=URI))
    request.addfinalizer(lambda: remove(lab))  # its folders of shared memory are not below tmp_path
    assert labs.load(Path(lab.folder)).mongodb_database == "swarm_field"
    assert entries.database(CliSettings(lab="field"), "mongodb://h", "") == ("mongodb://h", "swarm_field")
    files = [Path(lab.folder) / labs.FILE, lab.nodes[0].config_dir / "services" / "logger.toml"]
    assert {stat.S_IMODE(file.stat().st_mode) for file in files} == {0o600}
    written = load_service(lab.nodes[0].config_dir, "logger", entries.LoggerAddress)
    assert (written.mongodb_uri, written.mongodb_database) == (URI, "swarm_field")


def test_password_is_hidden_and_readable_file_named(tmp_path: Path) -> None:
    settings = node(tmp_path, mongodb_uri=URI)
    folder = Path(settings.config)
    file = folder / "services" / "logger.toml"
    file.chmod(0o644)
    found = {result.check: result for result in checks.examine({"uav1": folder}, fix=False)}
    assert found["mongodb"].verdict == "warning"
    assert f"{file}: its password is readable by all users" in found["mongodb"].text
    file.chmod(0o640)
    found = {result.check: result for result in checks.examine({"uav1": folder}, fix=False)}
    assert (found["mongodb"].verdict, "Connection refused" in found["mongodb"].text) == ("warning", True)
    shown = [str(key.value) for key in local_keys(folder, "logger/*").settings]
    assert "mongodb://swarm:***@" in " ".join(shown)
    assert not [text for text in [*shown, found["mongodb"].text] if "s3cret" in text]


def test_invalid_address_is_error_of_file(tmp_path: Path) -> None:
    folder = Path(node(tmp_path, mongodb_uri="mongo//swarm:s3cret@h").config)
    found = {result.check: result for result in checks.examine({"uav1": folder}, fix=False)}
    assert found["mongodb"].verdict == "error"
    assert "s3cret" not in found["mongodb"].text


def test_unreadable_entries_end_query_with_lost_data(tmp_path: Path) -> None:
    (tmp_path / "00000001.damaged").write_bytes(b"x")
    source = FolderSource([tmp_path])
    assert list(source.entries(Query())) == []
    with pytest.raises(Partial, match=r"the log is incomplete: .*00000001\.damaged"):
        entries.refuse_losses(source)
