"""The blocks of the documentation, and what a reader does with each."""

import re
from collections.abc import Iterator
from pathlib import Path
from textwrap import indent
from typing import NamedTuple

from tests.integration.cli.terminal import Terminal

ROOT = Path(__file__).parents[3]
PAGES = ROOT / "share/doc"
TUTORIALS = "tutorials/"
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
    """Why no test can run the block, or "" if the test runs it."""
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


def follow_page(page: str, terminal: Terminal) -> None:
    """Do what a reader of a page does, from top to bottom."""
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
        file = terminal.folder / block.file
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(block.text)
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
