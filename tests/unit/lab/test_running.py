"""Starting nodes and watching them: ready, fallen, late."""

import asyncio
import signal
import sys
from functools import partial
from pathlib import Path

import pytest

from swarmctl.session import labs, processes
from swarmctl.session.labs import LabNode, LabState
from swarmlab.provision import provisioning
from swarmlab.run import running
from swarmlab.run.notify import Restarts
from swarmlab.run.running import RunningLab
from swarmware.errors import NoAnswer, SwarmError
from swarmware.model.platform_kind import PlatformKind
from swarmware.runtime.backoff import RestartPolicy

READY = """
import os, signal, socket
with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as s:
    s.sendto(b"READY=1", os.environ["NOTIFY_SOCKET"])
signal.pause()
"""
RESTARTS = """
import os, signal, socket
with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as s:
    for word in ({words}):
        s.sendto(word, os.environ["NOTIFY_SOCKET"])
signal.pause()
"""
FALLS = "import sys; sys.exit('no such world')"
LATE = "import signal; signal.pause()"


def lab(tmp_path: Path, names: list[str]) -> LabState:
    nodes = []
    for name in names:
        (tmp_path / name).mkdir()
        nodes.append(
            LabNode(
                platform=name,
                kind=PlatformKind.UAV,
                folder=str(tmp_path / name),
                shm_dir=str(tmp_path / name / "shm"),
                processes="one",
                offset_s=0,
                drift_ppm=0,
            )
        )
    return LabState(
        name="t", experiment="formation", net="loopback", seed=1, folder=str(tmp_path), created_utc_ns=1,
        starter=processes.identity(1), multicast_group="", udp_port=1, nodes=tuple(nodes),
    )  # fmt: skip


@pytest.fixture
def node_program(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """What a node runs instead of swarmd, by its platform."""
    programs: dict[str, str] = {}

    def command(node: LabNode) -> list[str]:
        return [sys.executable, "-c", programs[node.platform]]

    monkeypatch.setattr(running, "command", command)
    return programs


async def start(rig: RunningLab, order: list[str], timeout_s: float = 20) -> None:
    try:
        await rig.start(order, timeout_s)
    finally:
        rig.stop_watching()
        processes.end([node.identity for node in rig.state.nodes], rig.state.mark)
        rig.wait_children()


def test_nodes_start_in_order_few_at_time(
    tmp_path: Path, node_program: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "at_once", lambda: 2)
    names = ["a", "b", "c", "d", "e"]
    node_program.update(dict.fromkeys(names, READY))
    rig = RunningLab(lab(tmp_path, names))
    seen: list[tuple[str, str]] = []
    rig.watcher = lambda platform, what: seen.append((platform, what))
    order = ["d", "a", "e", "c", "b"]
    asyncio.run(start(rig, order))
    assert [platform for platform, what in seen if what == "started"] == order
    alive = 0
    for _, what in seen:
        alive += 1 if what == "started" else -1
        assert alive <= 2
    known = labs.load(tmp_path)
    assert all(node.pid and node.pid_start for node in known.nodes), "whoever comes later can end them"


def test_fallen_node_is_named_with_log_end(tmp_path: Path, node_program: dict[str, str]) -> None:
    node_program.update({"a": LATE, "b": FALLS})
    with pytest.raises(SwarmError, match=r"(?s)node b: ended with exit code 1.*no such world"):
        asyncio.run(start(RunningLab(lab(tmp_path, ["a", "b"])), ["a", "b"]))


def test_log_of_fallen_node_is_named(tmp_path: Path, node_program: dict[str, str]) -> None:
    node_program["b"] = FALLS
    rig = RunningLab(lab(tmp_path, ["b"]))
    rig.log_of = lambda node: Path("report/logs") / node.platform / node.log_file.name
    with pytest.raises(SwarmError, match=r"\(report/logs/b/[a-z.]+\); expected to run"):
        asyncio.run(start(rig, ["b"]))


def test_nodes_that_are_late_are_named(tmp_path: Path, node_program: dict[str, str]) -> None:
    node_program.update({"a": READY, "b": LATE})
    with pytest.raises(NoAnswer, match="b not ready"):
        asyncio.run(start(RunningLab(lab(tmp_path, ["a", "b"])), ["a", "b"], timeout_s=0.5))


def test_one_that_is_asked_to_end_is_noticed(tmp_path: Path, node_program: dict[str, str]) -> None:
    node_program.update({"a": READY, "b": READY})

    async def kill_one(rig: RunningLab) -> set[str]:
        await rig.start(["a", "b"], 20)
        rig.state.node("b").identity.send(signal.SIGTERM)
        await rig.until_fallen()
        return set(rig.fallen)

    async def main() -> set[str]:
        rig = RunningLab(lab(tmp_path, ["a", "b"]))
        try:
            return await kill_one(rig)
        finally:
            rig.stop_watching()
            processes.end([node.identity for node in rig.state.nodes], rig.state.mark)
            rig.wait_children()

    assert asyncio.run(main()) == {"b"}


def test_killed_parent_restarts_and_counts_anew(tmp_path: Path, node_program: dict[str, str]) -> None:
    words = r'b"X_RESTARTS=1\nX_REASON=signal 11", b"READY=1"'
    node_program["a"] = RESTARTS.format(words=words)
    seen: list[str] = []

    async def main() -> None:
        rig = RunningLab(lab(tmp_path, ["a"]))
        news = asyncio.Event()

        def note(_: str, what: str) -> None:
            seen.append(what)
            news.set()

        rig.on_restart = note
        try:
            await rig.start(["a"], 20)
            before = rig.state.node("a").identity
            before.send(signal.SIGKILL)
            async with asyncio.timeout(20):
                while seen.count("ready again") < 2:
                    news.clear()
                    await news.wait()
            assert rig.state.node("a").identity not in {before, processes.identity(0)}
            assert labs.load(tmp_path).node("a").identity == rig.state.node("a").identity
            assert rig.restarts["a"].reasons == ("signal 11", "parent: signal 9", "signal 11")
            assert rig.fallen == {}
            rig.check()
        finally:
            rig.stop_watching()
            processes.end([node.identity for node in rig.state.nodes], rig.state.mark)
            rig.wait_children()

    asyncio.run(main())
    assert "restarted 2 times (signal 11, parent: signal 9)" in seen


@pytest.mark.parametrize("ending", [False, True])
def test_parent_dying_at_each_start_is_abandoned(
    tmp_path: Path, node_program: dict[str, str], monkeypatch: pytest.MonkeyPatch, ending: bool
) -> None:
    monkeypatch.setattr(running, "RestartPolicy", partial(RestartPolicy, pauses_s=(0.0,)))
    node_program["a"] = "import os; os.kill(os.getpid(), 9)"
    rig = RunningLab(lab(tmp_path, ["a"]))
    if ending:
        (tmp_path / provisioning.ENDING).touch()
    with pytest.raises(SwarmError, match="node a: ended with signal 9"):
        asyncio.run(start(rig, ["a"]))
    assert rig.restarts.get("a", Restarts()).count == (0 if ending else running.RESTARTS)


def test_a_node_gets_no_options_of_the_operator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SWARMCTL_NODE", "uav7")
    monkeypatch.setenv("WATCHDOG_USEC", "1")
    made = lab(tmp_path, ["a"])
    environment = running.environment(made, made.nodes[0])
    assert not [name for name in environment if name.startswith("SWARMCTL_") or name == "WATCHDOG_USEC"]
    assert environment[processes.MARK] == str(tmp_path)
    assert environment["NOTIFY_SOCKET"] == str(tmp_path / "a" / "notify")


def test_restart_by_supervisor_is_announced_and_kept(tmp_path: Path, node_program: dict[str, str]) -> None:
    word = r'b"X_RESTARTS=1\nX_REASON=signal 9", b"READY=1"'
    node_program["a"] = RESTARTS.format(words=word)
    rig = RunningLab(lab(tmp_path, ["a"]))
    seen: list[tuple[str, str]] = []
    rig.on_restart = lambda platform, what: seen.append((platform, what))
    asyncio.run(start(rig, ["a"]))
    assert seen == [("a", "restarted once (signal 9)"), ("a", "ready again")]
    assert rig.restarts == {"a": Restarts(1, ("signal 9",))}
    assert rig.fallen == {}


def test_work_continues_while_all_nodes_run(tmp_path: Path, node_program: dict[str, str]) -> None:
    node_program.update({"a": READY, "b": READY})

    async def work(rig: RunningLab) -> str:
        assert await rig.attended(asyncio.sleep(0, "done")) == "done"
        rig.state.node("b").identity.send(signal.SIGTERM)
        return str(await rig.attended(asyncio.Event().wait()))

    async def main() -> None:
        rig = RunningLab(lab(tmp_path, ["a", "b"]))
        try:
            await rig.start(["a", "b"], 20)
            await work(rig)
        finally:
            rig.stop_watching()
            processes.end([node.identity for node in rig.state.nodes], rig.state.mark)
            rig.wait_children()

    with pytest.raises(SwarmError, match="node b: ended with signal 15"):
        asyncio.run(main())
