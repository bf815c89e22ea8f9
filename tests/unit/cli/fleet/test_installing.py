"""The scripts that bring a wheel to a host and install it, with a pip that fails where it is told to."""

import hashlib
import subprocess
from pathlib import Path

import pytest

from swarmctl.commands.fleet.remote import _INSTALL, _UPLOAD

NAME = "swarmware-2.0-py3-none-any.whl"
PYTHON = """#!/bin/sh
# stands for the Python of the environment
root="$(dirname "$(dirname "$0")")"
if test "$1" = -c; then echo "$root/site"; exit; fi
for word in "$@"; do last="$word"; done
if test "$last" = --version; then exit 0; fi
if grep -q bad "$last"; then echo "ERROR: no space left on device" >&2; exit 1; fi
cat "$last" >"$root/site/software"
"""


class Environment:
    """An environment on a host."""

    def __init__(self, root: Path) -> None:
        self.root = root
        (root / "bin").mkdir()
        (root / "site").mkdir()
        python = root / "bin" / "python"
        python.write_text(PYTHON)
        python.chmod(0o755)

    def _run(self, script: str, content: bytes, name: str) -> "subprocess.CompletedProcess[bytes]":
        words = ["sh", "-c", script, "sh", str(self.root), name, hashlib.sha256(content).hexdigest()]
        return subprocess.run(words, input=content, capture_output=True, check=False)

    def upload(self, content: bytes, name: str = NAME) -> str:
        """Empty, or why it failed."""
        return self._run(_UPLOAD, content, name).stderr.decode().strip()

    def install(self, content: bytes, name: str = NAME) -> str:
        """Empty, or why it failed."""
        done = self._run(_INSTALL, content, name)
        assert bool(done.returncode) == bool(done.stderr)
        return done.stderr.decode().strip()

    @property
    def software(self) -> bytes:
        return (self.root / "site" / "software").read_bytes()

    @property
    def installed(self) -> str:
        return (self.root / "wheel" / "installed").read_text().strip()


@pytest.fixture
def environment(tmp_path: Path) -> Environment:
    made = Environment(tmp_path)
    assert made.upload(b"first") == ""
    assert made.install(b"first") == ""
    return made


def test_an_installed_wheel_is_recorded_by_its_sum(environment: Environment) -> None:
    assert environment.software == b"first"
    assert environment.installed == hashlib.sha256(b"first").hexdigest()


@pytest.mark.parametrize("name", [NAME, "swarmware-3.0-py3-none-any.whl"])
def test_wheel_that_cannot_be_installed_leaves_former_one(environment: Environment, name: str) -> None:
    assert environment.upload(b"bad", name) == ""
    (environment.root / "site" / "software").write_bytes(b"half of it")
    assert (
        environment.install(b"bad", name)
        == "ERROR: no space left on device; the former wheel is installed again"
    )
    assert environment.software == b"first"
    assert environment.installed == hashlib.sha256(b"first").hexdigest()
    assert environment.upload(b"third", name) == ""
    assert environment.install(b"third", name) == ""
    assert environment.software == b"third"


def test_error_without_former_wheel_has_only_reason(tmp_path: Path) -> None:
    environment = Environment(tmp_path)
    assert environment.upload(b"bad") == ""
    assert environment.install(b"bad") == "ERROR: no space left on device"


def test_unwritable_environment_is_found_before_node_stops(
    environment: Environment,
) -> None:
    site = environment.root / "site"
    (site / "software").unlink()
    site.rmdir()
    assert environment.upload(b"second").startswith(f"{site}: cannot be written; expected an environment")
    assert (environment.root / "wheel" / NAME).read_bytes() == b"first"


def test_a_wheel_that_arrives_incomplete_replaces_nothing(environment: Environment) -> None:
    words = ["sh", "-c", _UPLOAD, "sh", str(environment.root), NAME, "0" * 64]
    done = subprocess.run(words, input=b"sec", capture_output=True, check=False)
    assert done.stderr == b"the wheel arrived incomplete\n"
    assert (environment.root / "wheel" / NAME).read_bytes() == b"first"
