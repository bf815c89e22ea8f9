"""Imports of the fork server, none of which a fork would break."""

import subprocess
import sys


def test_daemon_imports_start_no_thread_nor_file() -> None:
    look = (
        "import os\n"
        "from swarmd.fork_server import OURS, preload\n"
        "from swarmware.service.installed import installed\n"
        "before = set(os.listdir('/proc/self/fd'))\n"
        "preload([name for name, point in installed().items() if point.value.startswith(OURS)])\n"
        "print(len(os.listdir('/proc/self/task')), *(set(os.listdir('/proc/self/fd')) - before))\n"
    )
    done = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["1"]


def test_foreign_service_is_not_imported_before_fork() -> None:
    look = (
        "from swarmware.footprint.entry_points import EntryPoint\n"
        "from swarmd import fork_server\n"
        "theirs = EntryPoint('planner', 'nosuch_package.planner:Planner', 'swarmware.services')\n"
        "fork_server.installed = lambda: {'planner': theirs}\n"
        "fork_server.preload(['planner', 'nosuch'])\n"
    )
    subprocess.run([sys.executable, "-c", look], check=True)
