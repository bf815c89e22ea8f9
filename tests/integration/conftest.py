"""What all integration tests share: a fork server for the processes of services that they start."""

from collections.abc import Iterator

import pytest

from swarmware.testing.forked import forking


@pytest.fixture(scope="session", autouse=True)
def fork_server() -> Iterator[None]:
    """One fork server for each pytest process, started before the first test, so no test is blamed for it."""
    with forking():
        yield
