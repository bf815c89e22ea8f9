"""Exit status of a process: from the kernel, between processes, and as a text for operators."""

import os
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.service.exit_status import ExitStatus
from swarmware.service.fork_client import exit_status_of


@pytest.mark.parametrize(
    ("code", "expected"),
    [("raise SystemExit(6)", ExitStatus(code=6)), ("import os; os.abort()", ExitStatus(signal=6))],
)
def test_process_end_is_code_or_signal(code: str, expected: ExitStatus) -> None:
    process = subprocess.Popen([sys.executable, "-c", code])
    result = os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    process.wait()
    assert result is not None
    assert exit_status_of(result) == expected
    assert exit_status_of(result).known


@given(st.integers(0, 255), st.booleans())
def test_text_of_exit_status_is_that_status_again(number: int, by_signal: bool) -> None:
    status = ExitStatus(signal=number) if by_signal else ExitStatus(code=number)
    assert str(status) == f"{'signal' if by_signal else 'exit'} {number}"
    assert ExitStatus.parse(str(status)) == status


@given(st.text() | st.sampled_from(["", "gone", "exit", "exit x", "exit -1", "signal ²", "exit " + "9" * 50]))
def test_any_other_text_is_an_unknown_exit_status(text: str) -> None:
    status = ExitStatus.parse(text)
    assert not status.known or str(status).split(" ")[0] == text.split(" ", maxsplit=1)[0]
    assert str(ExitStatus()) == "gone"
