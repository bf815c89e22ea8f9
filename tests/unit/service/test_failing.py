"""`swarmd` that fails under systemd, which starts it again at once and without limit."""

import os
from pathlib import Path

import pytest

import swarmd.main


@pytest.mark.parametrize(
    ("words", "starter", "waits"),
    [
        (["units", "--config", "nowhere"], "systemd", True),
        (["units", "--config", "nowhere"], "somebody else", False),
        (["ls"], "systemd", False),
    ],
)
def test_systemd_process_failing_at_once_ends_later(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, words: list[str], starter: str, waits: bool
) -> None:
    slept_s: list[float] = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("time.sleep", slept_s.append)
    monkeypatch.setenv("SYSTEMD_EXEC_PID", str(os.getpid() if starter == "systemd" else 1))
    code = swarmd.main.main(words)
    assert (code != 0) == (words[0] == "units")
    assert len(slept_s) == waits
    assert all(0.0 <= one_s <= swarmd.main.FAILED_S for one_s in slept_s)
