"""Every package says what may live in it, every daemon has its floors, a thin file is a noun of its own."""

import ast
import re
from collections import Counter
from pathlib import Path

import pytest
from tests.architecture.sources import CONTRACTS, ROOT, ROOTS, files, imports, parsed

PACKAGES = sorted(path.parent for root in ROOTS for path in (ROOT / root).rglob("__init__.py"))
PAGE = (ROOT / "share/doc/architecture.md").read_text("utf-8")
MIN_WORDS = 10
"""Fewer only repeat the package's name."""
THIN_LINES = 40
THIN = {
    "cli/swarmctl/terminal/size.py": "the size of the terminal, for the help, which imports no tables",
    "lib/swarmware/model/airframe_file.py": "reads files, which the cores that know airframes must not",
    "lib/swarmware/footprint/annotations.py": "placeholders of names that only annotations use",
    "lib/swarmware/footprint/blake2b.py": "BLAKE2b without OpenSSL",
    "lib/swarmware/recorder/address.py": "the address of a database, also without the driver of the database",
    "lib/swarmware/footprint/plain.py": "signals and sockets without enumerations, for the parent of a node",
    "lib/swarmware/version.py": "the version, below all that records or shows it",
}
"""Files of fewer lines that define no class of their own, and the noun that each is."""
TIDY = ("lib", "cli")
"""Roots in which a file of more lines has a reason."""
LONG_LINES = 350
LONG = {
    "cli/swarmctl/commands/fleet/agent.py": "the one program that runs on a host: orders, record, process",
    "cli/swarmctl/commands/tree/command.py": "the options and help texts of a dozen commands",
    "lib/swarmware/mission/block_reader.py": "one reader, whose parts name the place of an error alike",
    "lib/swarmware/mission/catalogue.py": "the table of built-in blocks, with the parameters of each",
    "lib/swarmware/mission/meetings.py": "one search over the states of all participants",
    "lib/swarmware/mission/reduction.py": "one reduction, whose rules share the net that they rewrite",
    "lib/swarmware/module/client.py": "what a module or a command can do at a node, each a few lines",
    "lib/swarmware/node/node.py": "the attachment of a process: what it holds is opened and closed here",
    "lib/swarmware/recorder/mongo.py": "the one file that imports pymongo",
    "lib/swarmware/recorder/segment.py": "writer and reader of one format, which change together",
    "lib/swarmware/transport/messaging/endpoint.py": "the endpoint that joins router and sockets",
    "lib/swarmware/transport/messaging/ipc_transport.py": "connections by ZMTP, with their buffers",
    "lib/swarmware/transport/messaging/router.py": "one state machine: every kind of frame, with its answer",
    "lib/swarmware/transport/shm/ring.py": "writer and reader of one memory layout, which change together",
    "lib/swarmware/types/channel.py": "the types of one area, which one page documents",
    "lib/swarmware/types/mission.py": "the types of one area, which one page documents",
}
"""Files of more lines that are not split, and the reason for each."""


def name(package: Path) -> str:
    return str(package.relative_to(ROOT)).partition("/")[2]


def sources() -> list[Path]:
    return [path for root in ROOTS for path in (ROOT / root).rglob("*.py") if "__" not in path.name]


def is_apart(path: Path) -> bool:
    """True for what a command does, however short: `--help` imports the options without it."""
    return (path.parent / "command.py").is_file()


@pytest.mark.parametrize("package", PACKAGES, ids=name)
def test_a_package_says_what_may_live_in_it(package: Path) -> None:
    docstring = ast.get_docstring(parsed(package / "__init__.py")) or ""
    purpose = docstring.partition("\n\n")[0]
    assert len(re.findall(r"\w+", purpose)) >= MIN_WORDS, f"{name(package)}: {purpose!r}"
    assert purpose.endswith(".")


def test_the_page_of_the_architecture_has_each_package() -> None:
    rows = re.findall(r"^\| `([\w/]+)` \| [^|]+ \| ([^|]*) \|$", PAGE.split("<!-- packages")[1], re.MULTILINE)
    shown = {top for top, _ in rows} | {
        f"{top}/{room}" for top, cell in rows for room in re.findall(r"`(.+?)`", cell)
    }
    assert shown == {name(package) for package in PACKAGES}


def test_every_daemon_has_floors_and_folder_of_decisions() -> None:
    daemons = {path.parent.name for path in (ROOT / "daemons/swarmd").glob("*/service.py")}
    (floors,) = (contract for contract in CONTRACTS if contract["id"] == "daemon-floors")
    (apart,) = (contract for contract in CONTRACTS if contract["id"] == "daemons")
    assert {f"swarmd.{daemon}" for daemon in daemons} == set(floors["containers"]) == set(apart["modules"])
    assert floors["exhaustive"]
    named = ["service", "core", "(config)"]
    assert [layer for layer in floors["layers"] if layer in named] == named
    assert daemons == {path.parent.name for path in (ROOT / "daemons/swarmd").glob("*/core/")}


def test_thin_file_defines_class_or_own_noun() -> None:
    thin = set()
    for path in sources():
        lines = path.read_text("utf-8").splitlines()
        if path.name in {"command.py", "config.py"} or is_apart(path) or len(lines) >= THIN_LINES:
            continue
        if not any(isinstance(node, ast.ClassDef) for node in parsed(path).body):
            thin.add(str(path.relative_to(ROOT)))
    assert thin == set(THIN), "merge it with its noun, or name the noun"


def test_a_thin_file_has_several_users() -> None:
    users = Counter(target for targets in imports().values() for target in targets)
    alone = {
        str(path.relative_to(ROOT))
        for name, path in files().items()
        if users[name] == 1
        and path.name != "__init__.py"
        and not is_apart(path)
        and len(path.read_text("utf-8").splitlines()) < THIN_LINES
    }
    assert alone == set(), "merge it with the only file that imports it"


def test_long_file_is_one_noun_with_reason() -> None:
    found = {
        str(path.relative_to(ROOT))
        for path in sources()
        if path.relative_to(ROOT).parts[0] in TIDY and len(path.read_text("utf-8").splitlines()) > LONG_LINES
    }
    assert found == set(LONG), "split it by its nouns, or give a reason here"
