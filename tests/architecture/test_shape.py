"""The shape of the repository: small files, defaults that are shipped as they are, nothing named by habit."""

import re
import tomllib
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec
import pytest

from swarmware.model.config import NodeConfig

ROOT = Path(__file__).parents[2]
SOURCES = sorted(
    path
    for folder in ("lib", "daemons", "cli", "tests", "share")
    for path in (ROOT / folder).rglob("*.py")
    if "__pycache__" not in path.parts
)
POINTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]["swarmware.services"]
SERVICES = sorted({point.split(".")[1] for point in POINTS.values()})
"""Packages of services; the parts of a service are in its package, and have its settings."""
LINES = 500
WORDS = 8
"""Words of a test's name, which states the unit and the outcome; the docstring has room for the rest."""


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_no_file_is_longer_than_500_lines() -> None:
    assert [name(path) for path in SOURCES if len(path.read_text("utf-8").splitlines()) > LINES] == []


def test_file_is_not_named_after_its_opposite() -> None:
    habit = re.compile(r"(^|_)(utils?|helpers?|common|manager|base|misc|part\d*)$")
    assert [name(path) for path in SOURCES if habit.search(path.stem)] == []


def test_no_file_imports_a_test_file() -> None:
    """What tests share is in a module that its name describes, or in a conftest."""
    importing = re.compile(r"^\s*(?:from|import) tests\.(?:\w+\.)*test_\w+", re.MULTILINE)
    assert [name(path) for path in SOURCES if importing.search(path.read_text("utf-8"))] == []


def test_name_of_test_has_eight_words_at_most() -> None:
    definition = re.compile(r"^\s*(?:async )?def test_(\w+)", re.MULTILINE)
    long = {
        f"{name(path)}: test_{words}"
        for path in SOURCES
        for words in definition.findall(path.read_text("utf-8"))
        if words.count("_") >= WORDS
    }
    assert long == set()


def test_the_shipped_node_file_equals_the_defaults() -> None:
    shipped = tomllib.loads((ROOT / "etc/swarm/node.toml").read_text())
    assert shipped == plain(NodeConfig())


@pytest.mark.parametrize("service", SERVICES)
def test_the_shipped_service_file_equals_the_defaults(service: str) -> None:
    config = import_module(f"swarmd.{service}.config").Config()
    text = (ROOT / f"etc/swarm/services/{service}.toml").read_text()
    assert tomllib.loads(text) == plain(config)


@pytest.mark.parametrize("service", SERVICES)
def test_every_key_of_a_shipped_file_is_explained(service: str) -> None:
    text = (ROOT / f"etc/swarm/services/{service}.toml").read_text()
    paragraphs = [part for part in text.split("\n\n") if re.search(r"^\w+ *=", part, re.MULTILINE)]
    assert all("#" in part for part in paragraphs)


def test_every_shipped_file_belongs_to_a_service() -> None:
    assert {path.stem for path in (ROOT / "etc/swarm/services").glob("*.toml")} == set(SERVICES)


def plain(value: Any) -> Any:
    """As TOML has it: lists for tuples, and no key for what may be absent."""
    return present(msgspec.json.decode(msgspec.json.encode(value)))


def present(value: Any) -> Any:
    """Without the keys that have no value."""
    if isinstance(value, list):
        return [present(item) for item in value]
    if not isinstance(value, dict):
        return value
    return {key: present(item) for key, item in value.items() if item is not None}
