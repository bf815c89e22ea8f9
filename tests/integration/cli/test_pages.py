"""The commands of the documentation, run as they are printed: each page from top to bottom, with a lab."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.integration.cli.pages import (
    PAGES,
    PARSED,
    RUN,
    TUTORIALS,
    TYPED,
    Block,
    as_printed,
    follow_page,
)
from tests.integration.cli.terminal import Terminal
from tests.integration.recorder.mongod import Mongod


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
def environment(environment: dict[str, str], database: str) -> dict[str, str]:
    """The environment of a reader, with the database of the page that needs one."""
    return {**environment, "MONGODB": database}


@pytest.mark.parametrize("page", [page for page in RUN if not page.startswith(TUTORIALS)])
def test_commands_of_page_do_what_it_says(page: str, terminal: Terminal) -> None:
    follow_page(page, terminal)


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
