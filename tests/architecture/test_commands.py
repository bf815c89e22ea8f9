"""Every command has help and an example, stands in the documentation, and leaves its logic to a function."""

import ast
import re
import shlex
from pathlib import Path

import click
import pytest
from tests.architecture.pages import generator
from tests.architecture.sources import ROOT, nodes

from swarmctl.commandline.arguments import ARGUMENTS, meaning
from swarmctl.main import cli, main

COMMANDS = {
    words: command
    for words, command, _ in generator().commands(cli, click.Context(cli, info_name="swarmctl"), "swarmctl")
}


@pytest.mark.parametrize("words", COMMANDS)
def test_command_has_sentence_and_example_it_accepts(words: str) -> None:
    about, example, words_of_it = (COMMANDS[words].help or "").partition("Example:")
    assert about.strip().rstrip(".")[0].isupper()
    assert example, f"{words}: no example"
    line = next(line.strip() for line in words_of_it.splitlines() if line.strip())
    assert "swarmctl" in line
    if "$(" in line or isinstance(COMMANDS[words], click.Group):
        return
    typed = shlex.split(line.split(" | ")[0].split(" > ")[0])
    assert " ".join(typed).startswith(words)
    COMMANDS[words].make_context(words, typed[len(words.split()) :], resilient_parsing=False, obj=None)


@pytest.mark.parametrize("words", COMMANDS)
def test_every_option_says_what_it_does(words: str) -> None:
    for option in generator().own_options(COMMANDS[words]):
        assert option.help or option.name == "help", f"{words} {option.opts}"


def test_figures_of_readme_are_those_of_measured_run() -> None:
    made = generator().readme()
    assert "| command to receipt | 11.95 ms |" in made


@pytest.mark.parametrize("path", generator().PAGES, ids=lambda path: str(path.name))
def test_a_generated_page_is_up_to_date(path: Path) -> None:
    made = generator().PAGES[path]()
    assert path.exists(), "run `make docs`"
    assert path.read_text() == made, "run `make docs`"


PAGES = {
    str(path.relative_to(ROOT)): path.read_text("utf-8")
    for path in (
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        *sorted((ROOT / "share/doc").rglob("*.md")),
    )
}


def typed_lines(text: str) -> list[str]:
    """Lines of code blocks that begin with the command, but not of pictures, without comments and pipes."""
    blocks = re.findall(r"^```\w*\n(.*?)^```|((?:^    .*\n)+)", text, re.MULTILINE | re.DOTALL)
    return [
        re.split(r"\s+#|\s+(?:\|\|?|>|&&) ", line.strip().removeprefix("$ "))[0]
        for fenced, indented in blocks
        for line in (fenced or indented).splitlines()
        if line.strip().removeprefix("$ ").startswith("swarmctl ") and not re.search(r"\$\(|\[|─", line)
    ]


def resolve(words: list[str]) -> tuple[str, list[str]]:
    """The command that the words name, as far as they name one, and the rest of the words."""
    name = "swarmctl"
    for i, word in enumerate(words[1:], 1):
        if f"{name} {word}" not in COMMANDS:
            return name, words[i:]
        name = f"{name} {word}"
    return name, []


@pytest.mark.parametrize("page", [page for page, text in PAGES.items() if typed_lines(text)])
def test_command_line_of_page_is_accepted(page: str) -> None:
    for line in typed_lines(PAGES[page]):
        name, args = resolve(shlex.split(line))
        if name == "swarmctl" and set(args) <= {option for param in cli.params for option in param.opts}:
            continue  # `swarmctl --version`
        assert name in COMMANDS, f"{page}: {line}"
        assert not (isinstance(COMMANDS[name], click.Group) and args), f"{page}: {line}: no command {args[0]}"
        if not isinstance(COMMANDS[name], click.Group):
            COMMANDS[name].make_context(name, args, resilient_parsing=False, obj=None)


@pytest.mark.parametrize("page", [page for page, text in PAGES.items() if "`swarmctl " in text])
def test_command_in_sentence_exists_with_its_options(page: str) -> None:
    for quoted in re.findall(r"`(swarmctl [^`\n]+)`", PAGES[page]):
        words = re.sub(r"[…\[\]]", " ", quoted).split()
        heads = words[1].split("|")
        for head in heads:
            if head.startswith("-") or head.isupper():
                continue
            name, args = resolve(["swarmctl", head, *words[2:]])
            assert name in COMMANDS, f"{page}: `{quoted}`"
            if isinstance(COMMANDS[name], click.Group) and args and "|" not in args[0]:
                assert args[0].startswith("--") or args[0].isupper(), f"{page}: `{quoted}`: {args[0]}"
            options = {
                option
                for words_of_it, command in COMMANDS.items()
                if words_of_it == name or words_of_it.startswith(f"{name} ")
                for param in command.params
                for option in (*param.opts, *param.secondary_opts)
            }
            assert {arg for arg in args if arg.startswith("--")} <= options, f"{page}: `{quoted}`"


def arguments() -> dict[str, list[str]]:
    """Names of the arguments, by the words of their command."""
    found = {
        words.partition(" ")[2]: [p.name or "" for p in command.params if isinstance(p, click.Argument)]
        for words, command in COMMANDS.items()
    }
    return {words: names for words, names in found.items() if names}


def test_every_argument_has_meaning_and_every_meaning_argument() -> None:
    without = [
        f"{words} {name}"
        for words, names in arguments().items()
        for name in names
        if not meaning(f"swarmctl {words}", name)
    ]
    assert without == []
    used = {
        one for words, names in arguments().items() for name in names for one in (name, f"{words} {name}")
    }
    assert sorted(ARGUMENTS.keys() - used) == []


def test_help_has_arguments_under_heading_of_their_own(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tree", "get", "--help"]) == 0
    shown = capsys.readouterr().out
    head, _, rest = shown.partition("Arguments:\n")
    middle, _, options = rest.partition("\nOptions:\n")
    assert "  PATH  " in middle
    assert "`**` at any depth" in " ".join(middle.split()), "patterns are explained where one is an argument"
    assert "PATH" not in options.split("Options of every command")[0]
    assert head.startswith("Usage: swarmctl tree get")


NESTED = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda, ast.ClassDef)
LOGIC = (*NESTED, ast.Await, ast.For, ast.AsyncFor, ast.While, ast.Try, ast.With, ast.comprehension)


def click_functions(path: Path) -> list[ast.FunctionDef]:
    return [
        node
        for node in nodes(path)
        if isinstance(node, ast.FunctionDef)
        and any(
            ast.unparse(decorator).partition("(")[0].endswith(".command") for decorator in node.decorator_list
        )
    ]


FUNCTIONS = {
    f"{path.relative_to(ROOT / 'cli')}:{function.name}": function
    for path in sorted((ROOT / "cli").rglob("*.py"))
    for function in click_functions(path)
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_click_function_has_no_logic_of_its_own(name: str) -> None:
    """A click function reads options and makes one call; its logic is a function that a test can call."""
    inside = [node for statement in FUNCTIONS[name].body for node in ast.walk(statement)]
    assert [ast.unparse(node) for node in inside if isinstance(node, LOGIC)] == []


@pytest.mark.parametrize(
    "folder", sorted(path.parent.name for path in (ROOT / "cli/swarmctl/commands").glob("*/command.py"))
)
def test_options_of_group_share_file_without_click_logic(folder: str) -> None:
    for path in (ROOT / "cli/swarmctl/commands" / folder).glob("*.py"):
        if path.name != "command.py":
            assert click_functions(path) == [], f"{path}: expected its options in command.py"
