"""What tests of pages share: the generator of pages, and a judgement of what a page cites."""

import ast
import importlib.util
import re
import shlex
from functools import cache
from pathlib import Path
from types import ModuleType

import click
from tests.architecture.sources import ROOT, parsed

from swarmctl.main import cli

DAEMON_COMMANDS = ("run", "node", "units", "ls")


def generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate", ROOT / "share/doc/generate.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def functions(path: Path) -> frozenset[str]:
    tree = parsed(path)
    return frozenset(n.name for n in tree.body if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef))


@cache
def targets() -> frozenset[str]:
    return frozenset(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


def accept_swarmctl(words: list[str]) -> None:
    """Raises: click.ClickException, when the command or an option of it does not exist."""
    command: click.Command = cli
    context = click.Context(cli, info_name="swarmctl")
    while isinstance(command, click.Group) and words:
        found = command.get_command(context, words[0])
        if found is None:
            raise click.UsageError(f"no command {words[0]!r} in {context.command_path!r}")
        command, words = found, words[1:]
        context = click.Context(command, parent=context, info_name=command.name)
    if not isinstance(command, click.Group):
        command.make_context(command.name, words, parent=context.parent)


def accept(shown: str) -> None:
    """Raises: click.ClickException, when the test or command does not exist."""
    if "::" in shown:
        path, _, function = shown.partition("::")
        if not path.startswith("tests/") or not (ROOT / path).is_file():
            raise click.UsageError("no such file below tests/")
        if not function.startswith("test_") or function not in functions(ROOT / path):
            raise click.UsageError("no such test in the file")
        return
    program, *words = shlex.split(shown)
    if program == "swarmctl":
        accept_swarmctl(words)
    elif not (
        (program == "swarmd" and words and words[0] in DAEMON_COMMANDS)
        or (program == "make" and words and words[0] in targets())
        or (program == "python" and words and (ROOT / words[0]).is_file())
    ):
        raise click.UsageError(
            "expected a test, or a command of swarmctl, swarmd, make or python that exists"
        )
