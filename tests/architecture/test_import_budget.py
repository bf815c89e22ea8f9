"""`swarmctl` stays fast because it imports little and collects no garbage meanwhile: counted, not timed."""

import ast
import asyncio
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import click
import pytest
from tests.architecture.sources import parsed

from swarmctl.main import cli
from swarmware.errors import ConfigError, NotFound
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.rpc import Empty

HEAVY: Final = {
    *(
        "asyncio",
        "concurrent.futures",
        "importlib.metadata",
        "multiprocessing",
        "ssl",
        "subprocess",
        "tomllib",
    ),
    *("jsonschema", "matplotlib", "mcap", "msgpack", "msgspec", "nacl", "numpy", "psutil", "pymongo"),
    *("rich", "tomli_w", "uvloop", "zmq", "zstandard"),
    *("swarmware.module", "swarmware.node", "swarmware.types", "swarmware.model.config"),
    *("swarmctl.terminal.output", "swarmlab.command"),
}
"""None of these may stand between an operator and the list of commands."""

BUDGET: Final = 60
"""Modules that a bare interpreter with click has not imported; 13 when this was written."""

READER_HEAVY: Final = {
    *("importlib.metadata", "multiprocessing", "shutil", "tempfile", "http", "email", "xml", "unittest"),
    *("jsonschema", "matplotlib", "mcap", "msgpack", "nacl", "numpy", "psutil", "pymongo", "rich", "sphinx"),
    *("uvloop", "yaml", "zmq", "zstandard", "swarmd", "ssl"),
}
"""A command that reads a running node uses none of these: each takes milliseconds."""

OVERVIEWS: Final = (
    "node ls",
    "link ls",
    "topo",
    "health ls",
    "health ready",
    "health faults",
    "time ls",
    "traffic ls",
)
OVERVIEW_HEAVY: Final = {
    *("json", "swarmctl.resources.classes", "swarmware.recorder", "swarmware.types.description"),
}
"""What shows values of any type; an overview shows values of types that it names."""

CLIENT_HEAVY: Final = {
    *("swarmware.module.module", "swarmware.module.accepted", "swarmware.module.inbox"),
    *("swarmware.module.rpc", "swarmware.module.streamwriter", "swarmware.module.writer"),
    *("swarmware.node.master.master", "swarmware.node.master.role", "swarmware.node.publication"),
    *("swarmware.transport.shm.reap", "swarmware.transport.shm.ring", "swarmware.recorder"),
    *("swarmware.model.explanation", "swarmware.model.toml_lines"),
}
"""What serves, writes, or can become master: a client that joins and asks uses none of it."""

ANSWERED: Final = {0, NotFound.exit_code, ConfigError.exit_code}
"""Exit codes with a folder that has no node: the command has got behind all its imports."""

READER_BUDGET: Final = 260
"""Modules that a reader imports in addition to `click`; 220 to 240 when this was written."""

TOP_LEVEL: Final = {"--version", "--help", "completion"}

BENCH: Final = Path(__file__).parents[1] / "bench/commands.py"

_READERS_PROBE: Final = """
import contextlib, io, json, sys
import click
before = set(sys.modules)
from swarmctl.main import main
found = {{}}
for line in {lines}:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        code = main([*line.split(), "--config", {folder!r}])
    found[line] = sorted(set(sys.modules) - before), code
print(json.dumps(found))
"""

_ASKS: Final = """
import asyncio, json, sys
from swarmware.module.client import Client
from swarmware.types.rpc import Empty
async def main():
    async with Client("tool", config_dir=sys.argv[1]) as client:
        await client.request("sys/probe/ask", Empty(), Empty, timeout_s=30)
asyncio.run(main())
print(json.dumps(sorted(sys.modules)))
"""

_PROBE: Final = """
import json, sys
if {click}:
    import click
else:
    from swarmctl.main import main
    assert main({args}) == 0
print()
print(json.dumps(sorted(sys.modules)))
"""


def printed(code: str, **environment: str) -> str:
    """Last line that a new interpreter prints."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()[-1]


def modules(args: list[str], *, click: bool = False) -> set[str]:
    return set(json.loads(printed(_PROBE.format(args=args, click=click))))


@pytest.mark.parametrize("args", [["--help"], ["--version"], ["completion", "fish"]])
def test_the_top_level_imports_nothing_heavy(args: list[str]) -> None:
    loaded = modules(args)
    assert not loaded & HEAVY
    extra = loaded - modules([], click=True)
    assert len(extra) <= BUDGET, sorted(extra)


def test_help_of_lab_imports_no_plotting_or_network() -> None:
    heavy = {"matplotlib", "numpy", "zmq", "pymongo", "psutil", "asyncio", "mcap", "rich"}
    assert not modules(["lab", "run", "--help"]) & heavy


def test_only_the_broker_loads_libzmq() -> None:
    code = (
        "import json, sys; import swarmware.module.module, swarmctl.session.session, swarmd.tree.service\n"
        "before = 'zmq' in sys.modules; import swarmd.broker.service\n"
        "print(before, 'zmq' in sys.modules)"
    )
    assert printed(code) == "False True"


def bench_table(name: str) -> Any:
    """A table of the bench, which is no importable module."""
    for statement in parsed(BENCH).body:
        if isinstance(statement, ast.AnnAssign) and ast.unparse(statement.target) == name:
            assert statement.value is not None
            return ast.literal_eval(statement.value)
    raise AssertionError(name)


def all_commands(command: click.Command, words: tuple[str, ...] = ()) -> Iterator[str]:
    if isinstance(command, click.Group):
        ctx = click.Context(command)
        for name in command.list_commands(ctx):
            found = command.get_command(ctx, name)
            assert found is not None
            yield from all_commands(found, (*words, name))
    else:
        yield " ".join(words)


def modules_of_readers(lines: Sequence[str], empty: Path) -> dict[str, tuple[set[str], int]]:
    """Modules that are loaded after each command, and its exit code, on a machine without a node or lab."""
    code = _READERS_PROBE.format(lines=lines, folder=str(empty / "none"))
    found = json.loads(printed(code, SWARMCTL_LABS=str(empty / "labs"), XDG_CACHE_HOME=str(empty)))
    return {line: (set(loaded), exit_code) for line, (loaded, exit_code) in found.items()}


def test_commands_that_read_import_nothing_heavy(tmp_path: Path) -> None:
    lines = [line for line in bench_table("COMMANDS") if line.partition(" ")[0] not in TOP_LEVEL]
    loaded: set[str] = set()
    for line, (modules_now, exit_code) in modules_of_readers(lines, tmp_path).items():
        assert exit_code in ANSWERED, line
        new, loaded = modules_now - loaded, modules_now
        assert not new & READER_HEAVY, line
        assert len(new) <= READER_BUDGET, (line, sorted(new))


def test_overviews_import_no_descriptions_of_types(tmp_path: Path) -> None:
    for line, (modules_now, exit_code) in modules_of_readers(OVERVIEWS, tmp_path).items():
        assert exit_code in ANSWERED, line
        assert not modules_now & OVERVIEW_HEAVY, line


async def test_asking_client_loads_no_server_and_no_writer(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("probe", node=node) as probe:
        probe.serve("sys/probe/ask", Empty, lambda request, meta: request, reply=Empty)
        child = await asyncio.create_subprocess_exec(
            *(sys.executable, "-c", _ASKS, str(node.config_dir)), stdout=subprocess.PIPE
        )
        out, _ = await child.communicate()
    assert child.returncode == 0
    assert not CLIENT_HEAVY & set(json.loads(out))


def test_each_command_is_measured_or_exempt_with_reason() -> None:
    measured = {
        line
        for line in all_commands(cli)
        if any(f"{m} ".startswith(f"{line} ") for m in bench_table("COMMANDS"))
    }
    left = [line for lines in bench_table("NOT_MEASURED").values() for line in lines.split(", ")]
    assert sorted([*measured, *left]) == sorted(all_commands(cli))


def test_a_command_collects_no_garbage_while_it_starts() -> None:
    code = (
        "import atexit, gc, sys; sys.argv = ['swarmctl', '--version']\n"
        "from swarmctl.__main__ import program\n"
        "before = sum(one['collections'] for one in gc.get_stats())\n"
        "atexit.register(lambda: print(sum(one['collections'] for one in gc.get_stats()) - before))\n"
        "program()"
    )
    assert printed(code) == "0"
