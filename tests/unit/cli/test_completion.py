"""Completion of paths and platforms from what was seen; no node is asked, nothing heavy is imported."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Literal

import msgspec
import pytest

from swarmctl.commandline import completion_cache, word_cache
from swarmctl.commandline.completion_cache import CachedResource, steps
from swarmctl.commandline.settings import CliSettings
from swarmctl.resources.listing import described_fields
from swarmctl.session.session import Session
from swarmctl.terminal.output import Output
from swarmware import __version__
from swarmware.testing.client import FakeClient
from swarmware.transport.appfile.file import AppFile
from swarmware.types.description import describe
from swarmware.types.field_values import DEPTH, field_values
from swarmware.types.mission import MissionAbort
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.scalar import Text
from swarmware.types.vehicle import ArmRequest, Pose

SEEN = [
    CachedResource("/gcs/tree", "branch", "r"),
    CachedResource("/gcs/tree/stats", "board", "r"),
    CachedResource("/uav1/nav/goal", "board", "rw"),
    CachedResource("/uav1/nav/pose", "board", "r"),
    CachedResource("/uav1/config/navigator/gain", "setting", "rw"),
    CachedResource("/uav10/nav/pose", "board", "r"),
    CachedResource("/uav10/cmd/abort", "command", "rw"),
]

KEYS = [("broker/tick_hz", False), ("broker/tcp_port", False), ("navigator/gain", True)]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    completion_cache.save("/etc/swarm", ["gcs", "uav1", "uav10"], SEEN)
    completion_cache.save_keys("/etc/swarm", "uav1", KEYS)
    types = {
        "/uav1/nav/pose": "Pose",
        "/uav1/nav/goal": "Goal",
        "/uav10/cmd/abort": "MissionAbort",
        "/uav1/config/navigator/gain": "Text",
        "/uav1/sys/arm": "ArmRequest",
    }
    fields = {cls.__name__: field_values(cls) for cls in (Pose, Goal, MissionAbort, ArmRequest, Text)}
    fields["/uav1/config/navigator/gain"] = {"value": ["auto", "manual"]}
    fields["/uav1/config/navigator/gain_hz"] = {"value": ["1.5", "2.0"]}
    hints = {"/uav1/config/navigator/gain_hz": "[0, 100] Hz, default 2.0 Hz"}
    word_cache.save("/etc/swarm", types, fields, ["harbour"], hints)
    return tmp_path / "swarm" / "seen.json"


def complete(words: str, cache: Path) -> list[str]:
    env = {
        **os.environ,
        "_SWARMCTL_COMPLETE": "bash_complete",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split(" ")) - 1),
        "XDG_CACHE_HOME": str(cache.parents[1]),
    }
    for name in ("SWARMCTL_NODE", "SWARMCTL_LAB"):
        env.pop(name, None)
    done = subprocess.run(
        [sys.executable, "-m", "swarmctl"], env=env, capture_output=True, text=True, check=True
    )
    return [line.partition(",")[2] for line in done.stdout.split()]


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("swarmctl tree get ", ["/gcs/", "/uav1/", "/uav10/"]),
        ("swarmctl tree get /uav1/", ["/uav1/nav/", "/uav1/config/"]),
        ("swarmctl tree get /uav1/n", ["/uav1/nav/goal", "/uav1/nav/pose"]),
        ("swarmctl tree get /uav10", ["/uav10/nav/pose"]),
        ("swarmctl tree set /uav1/", ["/uav1/nav/", "/uav1/config/"]),
        ("swarmctl tree set /uav10/", ["/uav10/cmd/abort"]),
        ("swarmctl tree get nav/", ["nav/goal", "nav/pose"]),
        ("swarmctl tree get -n uav10 ", ["nav/pose"]),
        ("swarmctl tree watch /uav1/nav/p", ["/uav1/nav/pose"]),
        ("swarmctl config get n", ["navigator/gain"]),
        ("swarmctl config undo n", ["navigator/gain"]),
        ("swarmctl config get b", ["broker/tick_hz", "broker/tcp_port"]),
        ("swarmctl config describe broker/ti", ["broker/tick_hz"]),
        ("swarmctl config set b", []),
        ("swarmctl config set n", ["navigator/gain"]),
        ("swarmctl config set navigator/gain ", ["auto", "manual"]),
        ("swarmctl config set -n uav1 navigator/gain m", ["manual"]),
        ("swarmctl config set -n uav2 navigator/gain m", []),
        ("swarmctl config set navigator/gain_hz ", ["1.5", "2.0"]),
        ("swarmctl tree get /uav1/config/", ["/uav1/config/navigator/gain"]),
        ("swarmctl node ls --node uav", ["uav1", "uav10"]),
        ("swarmctl node info g", ["gcs"]),
        ("swarmctl tree get /nope", []),
        (
            "swarmctl tree get /uav1/nav/pose.v",
            ["/uav1/nav/pose." + v for v in ("vx_m_s", "vy_m_s", "vz_m_s")],
        ),
        ("swarmctl tree watch nav/pose.x", ["nav/pose.x_m"]),
        ("swarmctl tree get -n uav1 nav/pose.x", ["nav/pose.x_m"]),
        ("swarmctl tree get /uav1/nav/pose --field y", ["y_m"]),
        ("swarmctl tree set /uav1/config/navigator/gain ", ["auto", "manual"]),
        ("swarmctl tree set /uav1/config/navigator/gain m", ["manual"]),
        ("swarmctl tree set /uav1/nav/goal.ki", ["/uav1/nav/goal.kind"]),
        ("swarmctl tree set /uav1/nav/goal.kind h", ["hold"]),
        ("swarmctl call /uav10/cmd/abort ", ["reason=", "then=", "epoch="]),
        ("swarmctl call /uav10/cmd/abort reason=x th", ["then="]),
        ("swarmctl call /uav1/sys/arm armed=", ["armed=true", "armed=false"]),
        ("swarmctl call /uav1/sys/arm armed =", ["true", "false"]),
        ("swarmctl call /uav1/sys/arm armed = f", ["false"]),
        ("swarmctl pub nav/goal kind=h", ["kind=hold"]),
        ("swarmctl wait /uav1/nav/pose vx", ["vx_m_s"]),
        ("swarmctl wait /uav1/nav/goal kind==", None),
        ("swarmctl mission start f", ["formation"]),
        ("swarmctl mission start h", ["harbour"]),
    ],
)
def test_a_shell_is_offered_what_was_seen(words: str, offered: list[str] | None, cache: Path) -> None:
    if offered is None:
        offered = [f"kind=='{kind.value}'" for kind in GoalKind]
    assert sorted(complete(words, cache)) == sorted(offered)


@pytest.mark.parametrize(
    "content",
    [b"", b"{}", b"[]", b'{"way": 1}', b"\xff", b'{"way":"","platforms":1,"resources":[[1]]}', b"[" * 9000],
)
def test_a_damaged_cache_offers_nothing_and_says_nothing(content: bytes, cache: Path) -> None:
    cache.write_bytes(content)
    assert completion_cache.load() == ("", [], [])
    completion_cache.save("/etc/swarm", ["uav1"], SEEN)
    assert completion_cache.load()[1] == ["uav1"]


def test_another_swarm_clears_completions_of_former(cache: Path) -> None:
    completion_cache.save("/etc/swarm", ["gcs", "usv1"], [CachedResource("/usv1/nav/pose", "board", "r")])
    assert len(completion_cache.load()[2]) == len(SEEN) + 2 + 1
    completion_cache.save("/tmp/lab", ["usv1"], [CachedResource("/usv1/nav/pose", "board", "r")])
    assert completion_cache.load() == ("/tmp/lab", ["usv1"], [CachedResource("/usv1/nav/pose", "board", "r")])


def test_fully_listed_platform_replaces_known_paths(cache: Path) -> None:
    completion_cache.save("/etc/swarm", ["uav1"], [CachedResource("/uav1/nav/home", "board", "r")], ["uav1"])
    paths = [row.path for row in completion_cache.load()[2]]
    assert "/uav1/nav/home" in paths
    assert "/uav1/nav/goal" not in paths
    assert "/uav10/nav/pose" in paths
    assert "/uav1/config/broker/tick_hz" in paths, "a list of resources has no keys of files"
    completion_cache.save_keys("/etc/swarm", "uav1", KEYS[1:])
    paths = [row.path for row in completion_cache.load()[2]]
    assert "/uav1/config/broker/tick_hz" not in paths
    assert "/uav1/config/broker/tcp_port" in paths


@pytest.mark.parametrize(
    "content", [b"", b"{}", b"[]", b'{"way":1,"types":[],"fields":{},"missions":[]}', b"[" * 9000, b"\xff"]
)
def test_damaged_words_offer_nothing(content: bytes, cache: Path) -> None:
    word_cache.file().write_bytes(content)
    assert word_cache.load() == word_cache.empty()
    assert complete("swarmctl tree get /uav1/nav/pose.v", cache) == []


def test_words_of_another_version_are_not_kept(cache: Path) -> None:
    word_cache.save("/etc/swarm", {"/usv1/nav/pose": "Pose"})
    stored = word_cache.file().read_text()
    word_cache.file().write_text(stored.replace(f'"version":"{__version__}"', '"version":"0.0.1"'))
    assert word_cache.load() == word_cache.empty()


def test_words_of_another_swarm_are_not_kept(cache: Path) -> None:
    word_cache.save("/tmp/lab", {"/usv1/nav/pose": "Pose"})
    assert word_cache.load() == word_cache.empty("/tmp/lab")._replace(types={"/usv1/nav/pose": "Pose"})


class Tree(msgspec.Struct):
    """A type that holds itself."""

    left: "Tree | None" = None
    mode: Literal["a", "b"] | None = None
    armed: bool = False
    path: list[int] = []


def test_nested_fields_complete_with_dotted_names_and_values() -> None:
    found = field_values(Tree)
    assert found["mode"] == ["a", "b"]
    assert found["left.armed"] == ["true", "false"]
    assert found["path"] == []
    assert max(name.count(".") for name in found) == DEPTH


def test_unwritable_home_is_not_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nowhere")
    completion_cache.save("/etc/swarm", ["uav1"], SEEN)
    word_cache.save("/etc/swarm", {"/uav1/nav/pose": "Pose"})
    assert word_cache.load() == word_cache.empty()
    assert completion_cache.load() == ("", [], [])


def test_a_step_is_never_a_lone_branch() -> None:
    assert steps(["/uav1/a/b/c"], "/u") == ["/uav1/a/b/c"]
    assert steps(["/uav1/a/b", "/uav1/a/c"], "") == ["/uav1/a/b", "/uav1/a/c"]
    assert steps(["a", "a/b"], "") == ["a", "a/"]
    assert steps([], "x") == []


_PROBE = """
import json, sys
before = set(sys.modules)
from swarmctl.main import cli
from click.shell_completion import BashComplete
found = BashComplete(cli, {}, "swarmctl", "_SWARMCTL_COMPLETE").get_completions(["tree", "get"], "/uav1/")
print(json.dumps([len(found), sorted(set(sys.modules) - before)]))
"""


def test_completion_imports_nothing_heavy(cache: Path) -> None:
    env = {**os.environ, "XDG_CACHE_HOME": str(cache.parents[1])}
    done = subprocess.run([sys.executable, "-c", _PROBE], env=env, capture_output=True, text=True, check=True)
    count, modules = json.loads(done.stdout)
    assert count == 2
    heavy = {"asyncio", "zmq", "msgspec", "nacl", "mcap", "numpy", "rich", "uvloop", "tomllib"}
    assert not heavy & set(modules)


class Rain(msgspec.Struct):
    mm: float
    heavy: bool


def test_fields_of_user_type_complete_before_reading(tmp_path: Path) -> None:
    described = {"Rain": msgspec.json.encode(describe(Rain)).decode(), "Snow": "[", "Hail": "{}"}
    settings = CliSettings(config="/etc/swarm")
    client = FakeClient("uav1", run_dir=str(tmp_path))
    session = Session(client, settings, Output(settings))
    file = AppFile(client.node.run_dir, "gauge", endpoint="ipc://x", started_ns=1)
    try:
        file.write(msgspec.structs.replace(file.entry, types=described))
        found = described_fields(session, {"uav1"}, {"Rain", "Snow", "Hail", "Fog"})
        assert described_fields(session, {"uav2"}, {"Rain"}) == {}, "of another machine"
    finally:
        file.close()
    assert found == {"Rain": {"mm": [], "heavy": ["true", "false"]}}
