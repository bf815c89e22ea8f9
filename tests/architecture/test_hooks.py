"""The hooks before a commit run what `make check` runs, and they run in a clean clone."""

import re
import subprocess
from pathlib import Path

import msgspec
import pytest

pytest.importorskip("pre_commit", reason="extra `dev` is not installed")

ROOT = Path(__file__).parents[2]
WHOLE = "mypy,lint-imports,language"
"""Hooks that check all code for half a minute, and that `make check` has run already."""


def hooks() -> dict[str, str]:
    """Commands by the name of their hook."""
    config = msgspec.yaml.decode((ROOT / ".pre-commit-config.yaml").read_bytes())
    return {hook["id"]: hook["entry"] for repo in config["repos"] for hook in repo["hooks"]}


def git(*args: str, where: Path) -> str:
    done = subprocess.run(["git", *args], cwd=where, capture_output=True, text=True, check=True)
    return done.stdout


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A clean clone of this repository that has this checkout's .venv, as `make hooks` would make it one."""
    if not (ROOT / ".git").exists():
        pytest.skip("no repository of git")
    folder = tmp_path / "clone"
    git("clone", "--quiet", str(ROOT), str(folder), where=tmp_path)
    (folder / ".venv").symlink_to(ROOT / ".venv")
    return folder


def run(folder: Path, *args: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [".venv/bin/pre-commit", "run", *args],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={
            "PATH": "/usr/bin:/bin",
            "HOME": str(folder.parent),
            "PRE_COMMIT_HOME": str(folder.parent / "cache"),
            "SKIP": WHOLE,
        },
    )


def test_every_check_of_make_lint_has_hook() -> None:
    recipe = re.search(r"^lint:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert recipe
    linted = {
        line.strip().replace("$(BIN)", ".venv/bin").removesuffix(" .") for line in recipe[1].splitlines()
    }
    assert linted <= set(hooks().values())
    assert any("tests/architecture/test_language.py" in entry for entry in hooks().values())


def test_the_hooks_pass_in_a_clean_clone(clone: Path) -> None:
    done = run(clone, "--all-files")
    assert done.returncode == 0, done.stdout + done.stderr
    passed = re.findall(r"^(.*?)\.+Passed$", done.stdout, re.MULTILINE)
    assert passed == ["ruff check", "ruff format"]


def test_hook_refuses_commit_that_ruff_refuses(clone: Path) -> None:
    (clone / "lib" / "swarmware" / "unused.py").write_text("import os\n")
    git("add", "--all", where=clone)
    done = run(clone)
    assert done.returncode == 1
    assert "F401" in done.stdout
