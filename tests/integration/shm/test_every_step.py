"""SIGKILL at every step of every operation: a restart heals it, and the reaper leaves nothing."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

DRIVER = Path(__file__).with_name("everystep.py")
OPERATIONS = [
    ast.literal_eval(key)
    for node in ast.parse(DRIVER.read_text(encoding="utf-8")).body
    if isinstance(node, ast.AnnAssign)
    and ast.unparse(node.target) == "CASES"
    and isinstance(node.value, ast.Dict)
    for key in node.value.keys
    if key is not None
]


@pytest.mark.parametrize("operation", OPERATIONS)
def test_kill_at_any_step_is_healed_by_restart(tmp_path: Path, operation: str) -> None:
    # a process of its own: it forks, and a fork wants a process without threads
    done = subprocess.run(
        [sys.executable, str(DRIVER), operation, str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) >= 5, "the operation has hardly any steps: is it traced at all?"
