"""Where a report comes from: the command that repeats it, the commit, the versions."""

import subprocess
from pathlib import Path
from shlex import split

import pytest

from swarmlab import experiment
from swarmlab.command import cmd
from swarmlab.experiment import run_command
from swarmlab.measure import software
from swarmlab.provision.provisioning import LabSpec


@pytest.mark.parametrize(
    "spec",
    [
        LabSpec(experiment="formation", nodes=16, seed=1),
        LabSpec(experiment="formation", nodes=5, seed=9, usv=1, name="mine", per_daemon="all"),
        LabSpec(experiment="formation", nodes=4, seed=2, airframe=("quad_1k5", "uav1=fixed_wing")),
        LabSpec(experiment="formation", nodes=4, seed=2, services=("files", "video")),
        LabSpec(experiment="formation", nodes=4, seed=2, mongodb_uri="mongodb://127.0.0.1:27017/x"),
    ],
)
def test_command_of_report_gives_same_run(spec: LabSpec, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[tuple[object, ...]] = []

    def record(*words: object, strict: bool) -> int:
        ran.append(words)
        return int(strict)

    monkeypatch.setattr(experiment, "main", record)
    words = split(run_command(spec, 90.5, Path("my report")))
    assert words[:3] == ["swarmctl", "lab", "run"]
    from click.testing import CliRunner

    from swarmctl.commandline.settings import CliSettings

    done = CliRunner().invoke(cmd, words[2:], obj=CliSettings())
    assert done.exit_code == 0, done.output
    assert ran[0][:3] == (spec, 90.5, Path("my report"))


def test_the_command_of_a_report_contains_no_password() -> None:
    spec = LabSpec(experiment="formation", nodes=4, seed=2, mongodb_uri="mongodb://me:secret@127.0.0.1/x")
    assert "secret" not in run_command(spec, 90, Path("out"))


def test_only_checkout_that_has_package_is_named(tmp_path: Path) -> None:
    def git(*words: str) -> None:
        who = ("-c", "user.name=n", "-c", "user.email=e@x")
        subprocess.run(["git", "-C", str(tmp_path), *who, *words], check=True, capture_output=True)

    package = tmp_path / "lib" / "swarmware"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    assert software.commit(package) == "", "not a checkout"
    git("init", "-q")
    git("commit", "-q", "--allow-empty", "-m", "another project")
    assert software.commit(package) == "", "a checkout of another project"
    git("add", ".")
    git("commit", "-q", "-m", "the package")
    clean = software.commit(package)
    assert len(clean) >= 7
    (package / "__init__.py").write_text("changed = 1")
    assert software.commit(package) == f"{clean}-dirty"


def test_versions_name_python_and_the_libraries() -> None:
    found = software.versions()
    assert {"Python", "pyzmq", "uvloop", "msgspec"} <= found.keys()
    assert all(found.values())
