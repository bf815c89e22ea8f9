"""Plug-in of pytest (`-p tests.idle`): its tests compute only while no other process wants the processors.

Tests that compute then run beside those that wait for real processes, and do not delay them.
"""

import os
from contextlib import suppress
from pathlib import Path

import pytest


def pytest_configure(config: pytest.Config) -> None:
    """The least of all priorities, for this process and what it starts."""
    if hasattr(config, "workerinput"):
        os.setsid()  # the kernel divides time among sessions first, and among the processes of each then
        with suppress(OSError):  # unless it is configured not to
            Path("/proc/self/autogroup").write_text("10")
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
