"""Every command has help and an example, and stands in the documentation."""

import importlib.util
import shlex
from pathlib import Path
from types import ModuleType

import click
import pytest

from swarmctl.main import cli

ROOT = Path(__file__).parents[2]


def generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate", ROOT / "share/doc/generate.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


COMMANDS = {
    words: command
    for words, command, _ in generator().commands(cli, click.Context(cli, info_name="swarmctl"), "swarmctl")
}


@pytest.mark.parametrize("words", COMMANDS)
def test_a_command_has_a_sentence_and_an_example_of_itself(words: str) -> None:
    about, example, words_of_it = (COMMANDS[words].help or "").partition("Example:")
    assert about.strip().rstrip(".")[0].isupper()
    assert example, f"{words}: no example"
    line = next(line.strip() for line in words_of_it.splitlines() if line.strip())
    assert "swarmctl" in line
    if "$(" not in line:
        typed = shlex.split(line.split(" | ")[0])
        assert " ".join(typed).startswith(words) or isinstance(COMMANDS[words], click.Group)


@pytest.mark.parametrize("words", [w for w, c in COMMANDS.items() if not isinstance(c, click.Group)])
def test_the_example_of_a_command_is_one_that_it_accepts(words: str) -> None:
    line = next(
        line.strip()
        for line in (COMMANDS[words].help or "").partition("Example:")[2].splitlines()
        if line.strip()
    )
    if "$(" in line:
        return
    args = shlex.split(line.split(" | ")[0].split(" > ")[0])[len(words.split()) :]
    COMMANDS[words].make_context(words, args, resilient_parsing=False, obj=None)


@pytest.mark.parametrize("words", COMMANDS)
def test_every_option_says_what_it_does(words: str) -> None:
    for option in generator().own_options(COMMANDS[words]):
        assert option.help or option.name == "help", f"{words} {option.opts}"


def test_the_figures_of_the_readme_are_those_of_the_measured_run() -> None:
    made = generator().readme()
    assert "| command to receipt | 11.95 ms |" in made
    assert (ROOT / "README.md").read_text() == made, "run `make docs`"


@pytest.mark.parametrize("page", ["cli.md", "types.md", "architecture.md"])
def test_a_generated_page_is_up_to_date(page: str) -> None:
    path, made = next((path, make()) for path, make in generator().PAGES.items() if path.name == page)
    assert path.exists(), "run `make docs`"
    assert path.read_text() == made, "run `make docs`"
