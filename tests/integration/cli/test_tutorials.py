"""The lessons, each followed from top to bottom with a lab, as they are printed."""

import os
import shutil
import subprocess
from collections.abc import Iterator

import pytest
from tests.integration.cli.pages import RUN, TUTORIALS, follow_page
from tests.integration.cli.terminal import Terminal

MACHINES = ("base", "uav1")
"""Network namespaces of the page of two machines."""


@pytest.fixture(autouse=True)
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


@pytest.mark.parametrize("page", [page for page in RUN if page.startswith(TUTORIALS)])
def test_commands_of_lesson_do_what_it_says(page: str, terminal: Terminal) -> None:
    follow_page(page, terminal)
