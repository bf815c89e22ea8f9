"""`swarmctl --help` stays fast because it imports next to nothing: counted, not timed."""

import json
import subprocess
import sys
from typing import Final

import pytest

HEAVY: Final = {
    *(
        "asyncio",
        "concurrent.futures",
        "importlib.metadata",
        "multiprocessing",
        "ssl",
        "subprocess",
        "tomllib",
    ),
    *("jsonschema", "matplotlib", "mcap", "msgpack", "msgspec", "nacl", "numpy", "psutil", "pymongo"),
    *("rich", "sortedcontainers", "tomli_w", "uvloop", "zmq", "zstandard"),
    *("swarmware.module", "swarmware.node", "swarmware.types", "swarmware.model.config"),
    *("swarmctl.terminal.output", "swarmlab.command"),
}
"""None of these may stand between an operator and the list of commands."""

BUDGET: Final = 60
"""Modules besides those of a bare interpreter that imports click; 13 when this was written."""

_PROBE: Final = """
import json, sys
if {click}:
    import click
else:
    from swarmctl.main import main
    assert main({args}) == 0
print(json.dumps(sorted(sys.modules)), file=sys.stderr)
"""


def modules(args: list[str], *, click: bool = False) -> set[str]:
    code = _PROBE.format(args=args, click=click)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(json.loads(done.stderr.splitlines()[-1]))


@pytest.mark.parametrize("args", [["--help"], ["--version"], ["completion", "fish"]])
def test_the_top_level_imports_nothing_heavy(args: list[str]) -> None:
    loaded = modules(args)
    assert not loaded & HEAVY
    extra = loaded - modules([], click=True)
    assert len(extra) <= BUDGET, sorted(extra)


def test_the_help_of_the_lab_imports_no_plotting_and_no_network() -> None:
    loaded = modules(["lab", "run", "--help"])
    assert not loaded & {"matplotlib", "numpy", "zmq", "pymongo", "psutil", "asyncio", "mcap", "rich"}


def test_only_the_broker_loads_libzmq() -> None:
    code = (
        "import json, sys; import swarmware.module.module, swarmctl.session.session, swarmd.tree.service\n"
        "before = 'zmq' in sys.modules; import swarmd.broker.service\n"
        "print(before, 'zmq' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]
