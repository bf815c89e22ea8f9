"""The command line of `swarmd`: the plain form is read as argparse reads it, every other form by argparse."""

import subprocess
import sys
from pathlib import Path

import pytest

from swarmd.command_line import parser
from swarmd.main import Options, parse

LINES = [
    ["run", "broker", "--config", "/etc/swarm"],
    ["run", "broker", "tree", "--config", "etc"],
    ["run", "broker", "broker"],
    ["run", "--config", "etc", "broker"],
    ["run", "broker", "--config=etc"],
    ["node", "--config", "etc"],
    ["node"],
    ["units"],
    ["ls"],
    ["forkserver", "--socket", "run/fork"],
    ["forkserver", "tree", "guard", "--socket", "run/fork", "--shared"],
]
REFUSED = [
    [],
    ["run"],
    ["run", "--config", "etc"],
    ["run", "broker", "--config"],
    ["run", "broker", "--config", "--x"],
    ["run", "-x", "--config", "etc"],
    ["ls", "broker", "--config", "etc"],
    ["fly", "broker", "--config", "etc"],
]


@pytest.mark.parametrize("words", LINES, ids=" ".join)
def test_command_line_means_what_argparse_makes_of_it(words: list[str]) -> None:
    expected = parser().parse_args(words)
    found = parse(words)
    assert (found.command, found.config) == (expected.command, getattr(expected, "config", None))
    assert found.services == getattr(expected, "services", [])
    assert found.socket == getattr(expected, "socket", Path())
    assert found.shared == getattr(expected, "shared", False)


@pytest.mark.parametrize("words", REFUSED, ids=" ".join)
def test_invalid_command_line_is_refused_with_usage(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as refused:
        parse(words)
    assert refused.value.code == 2
    assert "usage: swarmd" in capsys.readouterr().err


def test_options_have_no_default_in_common() -> None:
    first, second = Options(), Options()
    first.services.append("tree")
    assert second.services == []


def test_node_process_parses_arguments_without_argparse() -> None:
    code = (
        "import sys; from swarmd.main import parse; parse(['run', 'tree', '--config', 'etc'])\n"
        "print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "swarmd.main" in done.stdout.split()
    assert "argparse" not in done.stdout.split()


def test_a_folder_is_a_path() -> None:
    assert parse(["run", "tree", "--config", "etc"]).config == Path("etc")
