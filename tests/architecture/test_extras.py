"""What an extra of the distribution brings is needed by those alone who use it."""

import subprocess
import sys
from pathlib import Path

import pytest

from swarmware.testing.tmpnode import make_node

ROOT = Path(__file__).parents[2]
EXTRA = ("PIL", "av", "bson", "can", "jsonschema", "matplotlib", "numpy", "pyarrow", "pymongo")
BLOCK = f"import sys; sys.modules.update(dict.fromkeys({EXTRA!r}))\n"
"""None in `sys.modules` makes an import fail as it does where the module is not installed."""
REPORT = (
    *("distribution", "measure.formation_error", "measure.path_difference", "measure.recording"),
    *("measure.tracks", "measure.traffic_totals", "report.analysis", "report.charts"),
    *("report.difference_plot", "report.flight_map", "report.page", "report.plot_data"),
    *("report.plots", "report.replay", "report.svg", "report.time_chart", "report.timeline_chart"),
    *("report.link_chart",),
)
NEEDY = {
    "swarmware.recorder.mongo",
    *(f"swarmlab.{name}" for name in REPORT),
}
"""Modules that may need an extra; whoever uses them imports them late and says which one is missing."""


def modules(root: str) -> list[str]:
    paths = (path.relative_to(ROOT / root) for path in (ROOT / root).rglob("*.py"))
    found = {".".join(path.with_suffix("").parts).removesuffix(".__init__") for path in paths}
    return sorted(name for name in found - NEEDY if not name.endswith("__main__"))


def blocked(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", BLOCK + code], capture_output=True, text=True, check=False)


def swarmctl(*words: str) -> subprocess.CompletedProcess[str]:
    return blocked(f"from swarmctl.main import main; sys.exit(main({list(words)!r}))")


@pytest.mark.parametrize("root", ["lib", "daemons", "cli"])
def test_module_without_extra_is_imported_without_it(root: str) -> None:
    names = modules(root)
    assert len(names) > 50
    done = blocked(f"from importlib import import_module\nfor name in {names!r}: import_module(name)")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("words", [["--help"], ["lab", "up", "--help"], ["mission", "check", "formation"]])
def test_the_operators_command_works_without(words: list[str]) -> None:
    done = swarmctl(*words)
    assert done.returncode == 0, done.stderr


def test_value_of_tree_is_asked_for_without(tmp_path: Path) -> None:
    done = swarmctl("tree", "get", "nav/pose", "--config", str(make_node(tmp_path)))
    assert done.returncode == 4, "nothing runs on this node"
    assert "services do not run" in done.stderr


def test_vehicles_have_their_navigator_without_extra() -> None:
    done = blocked(
        "from swarmd.navigator.config import Config\n"
        "from swarmd.navigator.service import controller\n"
        "print(*(controller(kind, Config()).flies for kind in ('uav', 'ugv', 'usv')))\n"
    )
    assert done.stdout.split() == ["True", "False", "False"], done.stderr


def test_logger_without_extra_keeps_local_log(tmp_path: Path) -> None:
    done = blocked(
        "import asyncio\n"
        "from pathlib import Path\n"
        "from swarmd.logger.config import Config\n"
        "from swarmd.logger.upload import Upload\n"
        "class Health:\n"
        "    def report(self, *words, **_): print(*words)\n"
        "config = Config(mongodb_uri='mongodb://127.0.0.1')\n"
        f"upload = Upload(Path({str(tmp_path)!r}), 'uav1', config, Health())\n"
        "asyncio.run(asyncio.wait_for(upload.run(), 30))\n"
        "print(upload.state)\n"
    )
    *_, condition, state = done.stdout.splitlines()
    assert state.startswith("off: mongodb: the module ") and "swarmware[mongo]" in state, done.stderr
    assert condition == "mongodb misconfigured"


@pytest.mark.parametrize(
    ("words", "extra"),
    [
        (["log", "query", "--mongodb", "mongodb://127.0.0.1"], "mongo"),
        (["lab", "up", "formation", "--nodes", "3", "--mongodb", "mongodb://127.0.0.1"], "mongo"),
        (["lab", "run", "formation", "--nodes", "3", "--out", "report"], "lab"),
        (["lab", "report", "."], "lab"),
    ],
)
def test_command_names_missing_extra_before_anything_else(words: list[str], extra: str) -> None:
    done = swarmctl(*words)
    assert done.returncode == 7, done.stderr
    assert f"pip install 'swarmware[{extra}]'" in done.stderr
