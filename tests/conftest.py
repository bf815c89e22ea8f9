"""What all tests share: asynchronous tests run in an event loop of their own."""

import asyncio
import gc
import inspect

import pytest
from hypothesis import settings
from tests.simulation.seeds import examples

# no test judges wall time: the machine may be busy
settings.register_profile("swarm", deadline=None, max_examples=examples(30, 100))
settings.load_profile("swarm")
gc.disable()  # what collecting the tests makes stays until the end


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    """Modules and items stay until the end: the garbage collector needs not traverse them."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Runs `async def` tests; a task left behind or an unclosed transport becomes a warning, so a failure."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    asyncio.run(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names}))
    return True
