"""Secrets on the command line: given, in a file, from stdin; what cannot be read is named."""

from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from swarmctl.commandline.secret import LIMIT_BYTES, SECRET, TOKEN


@click.command()
@click.argument("token", type=TOKEN)
@click.option("--uri", type=SECRET, default="")
def show(token: str, uri: str) -> None:
    click.echo(f"{token}|{uri}")


def run(*words: str, stdin: bytes = b"") -> tuple[int, str]:
    result = CliRunner().invoke(show, words, input=stdin)
    return result.exit_code, result.output.strip()


def test_secret_comes_from_argument_file_or_stdin(tmp_path: Path) -> None:
    file = tmp_path / "secret"
    file.write_text("  mongodb://u:p@db/swarm\n")
    assert run("abc") == (0, "abc|")
    assert run(f"@{file}", "--uri", f"@{file}") == (0, "mongodb://u:p@db/swarm|mongodb://u:p@db/swarm")
    assert run("-", stdin=b"abc def \nmore") == (0, "abc def|")
    assert run("abc", "--uri", "@-", stdin=b"uri") == (0, "abc|uri")
    assert run("abc", "--uri", "-") == (0, "abc|-"), "the database of the node"
    file.write_bytes(b"\xef\xbb\xbfabc\r\n")
    assert run(f"@{file}") == (0, "abc|"), "a byte order mark of an editor is skipped"


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "empty"),
        (b" \n", "empty"),
        (b"\xff\xfe", "not UTF-8"),
        (b"x" * (LIMIT_BYTES + 1), "more than 4096"),
    ],
)
def test_invalid_secret_is_refused_with_place(tmp_path: Path, content: bytes, text: str) -> None:
    file = tmp_path / "secret"
    file.write_bytes(content)
    code, said = run(f"@{file}")
    assert code == 2 and text in said and "secret" in said
    code, said = run("-", stdin=content)
    assert code == 2 and text in said and "stdin" in said


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    code, said = run(f"@{tmp_path / 'none'}")
    assert code == 2 and "No such file" in said
    assert run(f"@{tmp_path}")[0] == 2
