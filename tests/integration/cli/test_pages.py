"""The commands of the documentation, run as they are printed: each page from top to bottom, with a lab."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.integration.cli.conftest import Lab
from tests.integration.recorder.mongod import Mongod

ROOT = Path(__file__).parents[3]
PAGES = ROOT / "share/doc"
BY_OTHERS = {"operations.md"}
"""Pages whose commands another test runs: tests/boot on a booted systemd."""
BLOCK = re.compile(
    r"(?:^<!-- not run: ([^\n]+) -->\n)?^```(sh|console)\n(.*?)^```$", re.MULTILINE | re.DOTALL
)
BLOCK_S = 90.0


class Block(NamedTuple):
    """A block of commands of a page."""

    page: str
    line: int
    language: str
    text: str
    reason: str
    """Why no test can run it; empty: it is run."""

    @property
    def place(self) -> str:
        return f"{self.page}:{self.line}"


def blocks(path: Path) -> Iterator[Block]:
    text = path.read_text("utf-8")
    for match in BLOCK.finditer(text):
        line = text[: match.start(3)].count("\n") + 1
        yield Block(str(path.relative_to(PAGES)), line, match[2], match[3], match[1] or "")


FOUND = [block for path in sorted(PAGES.rglob("*.md")) for block in blocks(path)]
RUN = sorted({block.page for block in FOUND if not block.reason} - BY_OTHERS)
PARSED = [block for block in FOUND if block.reason or block.page in BY_OTHERS]


def bash(text: str, folder: Path, env: dict[str, str], options: str = "-eo pipefail") -> tuple[int, str]:
    done = subprocess.run(
        ["bash", *options.split(), "-c", text],
        cwd=folder,
        env=env,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        timeout=BLOCK_S,
    )
    return done.returncode, done.stdout


def typed(block: Block) -> Iterator[tuple[str, str]]:
    """The commands of a console block, each with the output that is printed below it."""
    for part in re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]:
        command, _, output = part.partition("\n")
        yield command, output


def as_printed(output: str, printed: str) -> bool:
    """Whether a command printed what the page shows; `…` stands for any text of a line."""
    return re.fullmatch(re.escape(printed).replace("…", ".*"), output) is not None


@pytest.fixture
def environment(lab: Lab) -> dict[str, str]:
    """That of a reader: the environment in which Swarmware is installed is active, and a lab runs."""
    here = Path(sys.executable).parent
    return {**lab.env, "PATH": f"{here}{os.pathsep}{os.environ['PATH']}"}


@pytest.fixture
def database(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """Address of a database server, for the page that needs one."""
    if "mongodb" not in request.node.callspec.id:
        yield ""
        return
    server = Mongod(tmp_path / "mongod")
    server.start()
    try:
        yield server.uri
    finally:
        server.stop()


@pytest.mark.parametrize("page", RUN)
def test_the_commands_of_a_page_do_what_it_says(
    page: str, environment: dict[str, str], database: str, tmp_path: Path
) -> None:
    env = {**environment, "MONGODB": database}
    for block in FOUND:
        if block.page != page or block.reason:
            continue
        if block.language == "sh":
            code, output = bash(block.text, tmp_path, env)
            assert code == 0, f"{block.place}: exit code {code}\n{output}"
            assert "Traceback" not in output, f"{block.place}\n{output}"
            continue
        for command, printed in typed(block):
            _, output = bash(command, tmp_path, env, "")
            assert as_printed(output, printed), f"{block.place}: {command}\n{output}"


@pytest.mark.parametrize("block", PARSED, ids=lambda block: block.place)
def test_a_block_that_cannot_be_run_is_parsed(block: Block, tmp_path: Path) -> None:
    code, output = bash(block.text, tmp_path, dict(os.environ), "-n")
    assert (code, output) == (0, "")


def test_the_pages_of_all_tasks_are_run() -> None:
    tasks = {f"howto/{path.name}" for path in (PAGES / "howto").glob("*.md")} - {"howto/index.md"}
    assert tasks | {"quickstart.md", "reference/paths.md"} <= {block.page for block in FOUND}
    assert {"howto/logs.md", "howto/faults.md", "quickstart.md", "reference/paths.md"} <= set(RUN)


@pytest.mark.parametrize(
    ("output", "printed", "same"),
    [("a 1\n", "a …\n", True), ("a 1\nb\n", "a …\n", False), ("a\n", "b\n", False), ("a.c", "abc", False)],
)
def test_an_output_is_compared_with_what_is_printed(output: str, printed: str, same: bool) -> None:
    assert as_printed(output, printed) is same
