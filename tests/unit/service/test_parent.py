"""The parent of a node's processes lives as long as the node: it must stay small."""

import subprocess
import sys
from typing import Final

HEAVY: Final = ("argparse", "asyncio", "logging", "msgspec", "pathlib", "re", "typing", "uvloop", "zmq")


def test_the_parent_loads_nothing_that_it_does_not_need() -> None:
    look = "import sys, swarmd.parent; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True).stdout
    assert "swarmd.parent" in loaded.split()
    assert not set(HEAVY) & set(loaded.split())
