"""The counters against the bytes that the kernel saw."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.mark.root
def test_counted_bytes_are_those_on_the_wire() -> None:
    if os.geteuid() != 0 or shutil.which("unshare") is None or shutil.which("ip") is None:
        pytest.skip("needs root, unshare and ip for a network namespace of its own")
    program = Path(__file__).with_name("onthewire.py")
    done = subprocess.run(
        ["unshare", "--net", sys.executable, str(program), "4"],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    if "unshare failed" in done.stderr:
        pytest.skip(f"no network namespace here: {done.stderr.strip()}")
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert seen["tcp"] > 100_000
    assert seen["udp"] > 5_000
    assert seen["sent"] == pytest.approx(seen["wire"], rel=0.03), seen
    # what one sent over TCP another received; a datagram to all is received by two
    assert seen["tcp_received"] == pytest.approx(seen["tcp"], rel=0.06), seen
    assert seen["udp_received"] == pytest.approx(2 * seen["udp"], rel=0.05), seen
