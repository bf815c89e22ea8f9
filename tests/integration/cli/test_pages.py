"""The commands of the documentation, run as they are printed: each page from top to bottom, with a lab."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from textwrap import indent
from typing import NamedTuple

import pytest
from tests.integration.cli.conftest import Lab
from tests.integration.cli.terminal import Terminal
from tests.integration.recorder.mongod import Mongod

ROOT = Path(__file__).parents[3]
PAGES = ROOT / "share/doc"
TUTORIALS = "tutorials/"
MACHINES = ("base", "uav1")
"""Network namespaces of the page of two machines."""
BY_OTHERS = {"operations.md"}
"""Pages whose commands another test runs: tests/boot on a booted systemd."""
COMMANDS = ("sh", "console")
FILES = ("ini", "json", "python", "toml")
"""Languages of files: below a line that ends with `path`: the file is written, elsewhere it is an excerpt."""
BLOCK = re.compile(
    rf"(?:^<!-- not run: ([^\n]+) -->\n|`([\w./-]+)`:\n\n)?^```({'|'.join(COMMANDS + FILES)})\n(.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


class Block(NamedTuple):
    """A block of commands of a page."""

    page: str
    line: int
    language: str
    text: str
    reason: str
    """Why no test can run it; empty: it is run."""
    file: str
    """Path of the file that a reader writes."""

    @property
    def place(self) -> str:
        return f"{self.page}:{self.line}"


def blocks(path: Path) -> Iterator[Block]:
    text = path.read_text("utf-8")
    for match in BLOCK.finditer(text):
        line = text[: match.start(4)].count("\n") + 1
        yield Block(str(path.relative_to(PAGES)), line, match[3], match[4], match[1] or "", match[2] or "")


FOUND = [block for path in sorted(PAGES.rglob("*.md")) for block in blocks(path)]
TYPED = [block for block in FOUND if block.language in COMMANDS]
RUN = sorted({block.page for block in TYPED if not block.reason} - BY_OTHERS)
PARSED = [block for block in TYPED if block.reason or block.page in BY_OTHERS]


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
    """That of a reader: the environment in which Swarmware is installed is active, and a lab runs.

    What `pip` installs, without a network, the lab finds, and it is removed with the lab.
    """
    here = Path(sys.executable).parent
    pip = {"DISABLE_PIP_VERSION_CHECK": "1", "NO_BUILD_ISOLATION": "0", "NO_COMPILE": "0", "NO_DEPS": "1"}
    pip |= {"NO_INDEX": "1", "ROOT_USER_ACTION": "ignore", "TARGET": lab.env["PYTHONPATH"]}
    return {
        **lab.env,
        **{f"PIP_{name}": value for name, value in pip.items()},
        "PATH": f"{here}{os.pathsep}{os.environ['PATH']}",
    }


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


@pytest.fixture
def machines(request: pytest.FixtureRequest) -> Iterator[None]:
    """The network namespaces of the page that makes them: permitted here, and removed at the end."""
    if "two-machines" not in request.node.callspec.id:
        yield
        return
    if os.geteuid() != 0 or shutil.which("ip") is None:
        pytest.skip("network namespaces need root rights and `ip` of iproute2")
    probe = ["ip", "netns", "add", MACHINES[0]]
    if (done := subprocess.run(probe, capture_output=True, text=True, check=False)).returncode:
        pytest.skip(f"network namespaces are not permitted here: {done.stderr.strip()}")
    subprocess.run(["ip", "netns", "delete", MACHINES[0]], check=True)
    try:
        yield
    finally:
        for name in MACHINES:
            # the last step of the page has removed it, if the page was followed to its end
            subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)


@pytest.fixture
def terminal(
    environment: dict[str, str], database: str, machines: None, tmp_path: Path
) -> Iterator[Terminal]:
    found = Terminal(tmp_path, {**environment, "MONGODB": database})
    try:
        yield found
    finally:
        found.close()


@pytest.mark.parametrize("page", RUN)
def test_the_commands_of_a_page_do_what_it_says(page: str, terminal: Terminal) -> None:
    for block in FOUND:
        if block.page == page and not block.reason:
            follow(block, terminal)


def follow(block: Block, terminal: Terminal) -> None:
    """Do what a reader does with a block."""
    if block.language == "sh":
        code, output = terminal.run(block.text)
        assert code == 0, f"{block.place}: exit code {code}\n{output}"
        assert "Traceback" not in output, f"{block.place}\n{output}"
    elif block.language == "console":
        for command, printed in typed(block):
            _, output = terminal.run(command, strict=False)
            assert as_printed(output, printed), f"{block.place}: {command}\n{output}"
    elif block.file:
        (terminal.folder / block.file).write_text(block.text)
    elif block.page.startswith(TUTORIALS):
        assert excerpt(block.text, terminal.folder), f"{block.place}: in no file below {terminal.folder}"


def excerpt(text: str, folder: Path) -> bool:
    """Whether these lines, indented as they may be, are in a file of the folder."""
    return any(
        indent(text, " " * columns) in path.read_text(errors="replace")
        for path in folder.rglob("*")
        if path.is_file()
        for columns in (0, 4, 8)
    )


@pytest.mark.parametrize("block", PARSED, ids=lambda block: block.place)
def test_a_block_that_cannot_be_run_is_parsed(block: Block, tmp_path: Path) -> None:
    done = subprocess.run(
        ["bash", "-n"], input=block.text, capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_the_pages_of_all_tasks_are_run() -> None:
    tasks = {f"howto/{path.name}" for path in (PAGES / "howto").glob("*.md")} - {"howto/index.md"}
    lessons = {f"{TUTORIALS}{path.name}" for path in (PAGES / TUTORIALS).glob("*.md")}
    assert lessons - {f"{TUTORIALS}index.md"} <= set(RUN)
    assert tasks | {"quickstart.md", "reference/paths.md"} <= {block.page for block in TYPED}
    assert {"howto/logs.md", "howto/faults.md", "quickstart.md", "reference/paths.md"} <= set(RUN)


@pytest.mark.parametrize(
    ("output", "printed", "same"),
    [("a 1\n", "a …\n", True), ("a 1\nb\n", "a …\n", False), ("a\n", "b\n", False), ("a.c", "abc", False)],
)
def test_an_output_is_compared_with_what_is_printed(output: str, printed: str, same: bool) -> None:
    assert as_printed(output, printed) is same
