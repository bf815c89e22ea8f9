"""What lives as long as a process of services is not searched for garbage again and again."""

import asyncio
import gc
from collections.abc import Iterator

import pytest
from tests.patience import PATIENCE_S

from swarmware.service import runner


@pytest.fixture
def thawed() -> Iterator[None]:
    """Frozen objects of the test are released."""
    gc.unfreeze()
    yield
    gc.unfreeze()


@pytest.mark.usefixtures("thawed")
def test_import_garbage_is_spared_even_after_failure() -> None:
    with pytest.raises(ImportError), runner.frozen():
        assert not gc.isenabled()
        raise ImportError
    assert gc.isenabled()
    assert gc.get_freeze_count() > 0


@pytest.mark.usefixtures("thawed")
async def test_a_settled_process_spares_all_but_its_garbage(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "SETTLED_S", 0.0)
    collected = asyncio.Event()

    class Circle:
        def __init__(self) -> None:
            self.me = self

        def __del__(self) -> None:
            collected.set()

    Circle()
    runner.freeze_later(asyncio.get_running_loop())
    async with asyncio.timeout(PATIENCE_S):
        await collected.wait()
    await asyncio.sleep(0)
    assert gc.get_freeze_count() > 0
