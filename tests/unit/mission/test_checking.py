"""The check beside the event loop: the same verdicts, bounded in memory and time, and asked for once."""

import asyncio
import gc
import json
import re
import time
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

import pytest
from tests.unit.mission.nets import lattice, net

from swarmd.mission import checking
from swarmd.mission.checking import Checker
from swarmware.errors import MissionError
from swarmware.mission.assignment import Platform, assign
from swarmware.mission.binding import Binding
from swarmware.mission.catalogue import built_in
from swarmware.mission.finding import sound
from swarmware.mission.folder import Folder, from_files
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionFile, ParamValue

T = TypeVar("T")

LAG_S = 1.0
"""Far above the processor time of a quick check, far below the time of a full check."""
PATIENCE_S = 600.0
"""Instead of the time-out of a check: a busy computer starts its process late; findings are judged here."""


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checking, "TIME_S", PATIENCE_S)


def fork(width: int, chain: int = 1, last: str = "j") -> str:
    """A mission of `width` parallel branches, each a line of pauses."""
    blocks: dict[str, Any] = {}
    for branch in range(width):
        for step in range(chain):
            after = last if step == chain - 1 else f"w{branch}_{step + 1}"
            blocks[f"w{branch}_{step}"] = f"Wait>{after}"
    heads = ",".join(f"w{branch}_0" for branch in range(width))
    return net(s="Start>f", f=f"Fork>{heads}", **blocks, j="Join>e", e="End")


def alone(text: str) -> Folder:
    return from_files([MissionFile("m.json", text)], "trial")


class NoProcess:
    """Stands where a process would be started."""

    def __init__(self) -> None:
        self.jobs = 0

    async def __call__(self, job: object, where: str) -> list[Any]:
        self.jobs += 1
        return []


def measured(work: Callable[[], Awaitable[T]]) -> tuple[T, float]:
    """What came of it, and the most processor time of the event loop's thread between two looks."""

    async def run() -> tuple[T, float]:
        worst_s, done = 0.0, asyncio.Event()

        async def watch() -> None:
            nonlocal worst_s
            while not done.is_set():
                before_s = time.thread_time()
                await asyncio.sleep(0.001)
                worst_s = max(worst_s, time.thread_time() - before_s)

        async with asyncio.TaskGroup() as group:
            group.create_task(watch())
            await asyncio.sleep(0)
            try:
                result = await work()
            finally:
                done.set()
        return result, worst_s

    gc.disable()  # a collection visits the heap of all tests
    try:
        return asyncio.run(run())
    finally:
        gc.enable()


def test_a_small_mission_is_checked_without_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    apart = NoProcess()
    monkeypatch.setattr(checking, "_apart", apart)
    assert asyncio.run(Checker(built_in()).check(alone(fork(3)))) == ()
    assert apart.jobs == 0


def test_mission_is_checked_once_for_all_purposes(monkeypatch: pytest.MonkeyPatch) -> None:
    apart = NoProcess()
    monkeypatch.setattr(checking, "_apart", apart)

    async def work() -> None:
        checker = Checker(built_in())
        large = lattice(9, 2)
        first = await checker.check(alone(large))
        assert await checker.check(alone(large)) is first
        binding = Binding("uav1", PlatformKind.UAV)
        mission = await checker.load(large, "m.json", binding)
        assert await checker.load(large, "m.json", binding) is mission
        assert await checker.load(large, "m.json", Binding("uav2", PlatformKind.UAV)) is not mission

    asyncio.run(work())
    assert apart.jobs == 3


def test_sound_verdict_holds_and_findings_name_place() -> None:
    async def work() -> None:
        checker = Checker(built_in())
        stored = from_files([MissionFile("m.json", fork(3))], "/stored/trial")
        sent = from_files([MissionFile("m.json", fork(3))], "operator")
        assert await checker.check(sent) is await checker.check(stored)
        wrong = fork(3, last="nowhere")
        for place in ("/stored/trial", "operator"):
            findings = await checker.check(from_files([MissionFile("m.json", wrong)], place))
            assert findings and all(finding.file.startswith(place) for finding in findings)

    asyncio.run(work())


def test_long_check_is_sound_without_blocking_loop() -> None:
    checker = Checker(built_in())
    findings, lag_s = measured(lambda: checker.check(alone(lattice(7, 2))))
    assert findings == ()
    assert lag_s < LAG_S


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (fork(2_500), "take no time follow at once|too large to check"),  # whatever the load lets it see
        (lattice(12, 3), "too large to check"),
        (
            net(s="Start>w0", **{f"w{i}": f"Wait>x{i}" for i in range(12_000)}, e="End"),
            "not read",
        ),
        (net(s="Start>w0", **{f"w{i}": "Wiat>w1" for i in range(14_000)}, e="End"), "not read"),
    ],
    ids=[
        "2500 at once",
        "12 that meet their neighbours",
        "12000 successors that do not exist",
        "14000 mistakes",
    ],
)
def test_mission_too_large_to_check_is_refused(text: str, reason: str) -> None:
    checker = Checker(built_in())
    findings, lag_s = measured(lambda: checker.check(alone(text)))
    assert not sound(findings)
    assert any(re.search(reason, finding.message) for finding in findings)
    assert lag_s < LAG_S

    async def load() -> str:
        with pytest.raises(MissionError) as caught:
            await checker.load(text, "m.json", Binding())
        return str(caught.value)

    refusal, lag_s = measured(load)
    assert re.search(reason, refusal)
    assert lag_s < LAG_S


def test_check_whose_process_is_killed_refuses_mission(monkeypatch: pytest.MonkeyPatch) -> None:
    checker = Checker(built_in())
    with monkeypatch.context() as hurried:
        hurried.setattr(checking, "TIME_S", 0.01)
        (finding,) = asyncio.run(checker.check(alone(lattice(7, 2))))
    assert (finding.severity, finding.rule) == ("unknown", "unfinished")
    # that is no verdict about the mission: the next request checks it
    assert asyncio.run(checker.check(alone(lattice(7, 2)))) == ()


@pytest.mark.parametrize(("height", "accepted"), [("abc", False), (-3.0, False), (True, False), (4.0, True)])
async def test_parameter_values_are_checked_with_role_texts(height: ParamValue, accepted: bool) -> None:
    text = net(
        s="Start>a",
        a="Arm>t",
        t={"type": "Takeoff", "alt": "$param.height_m", "next": "l"},
        l="Land>e",
        e="End",
    )
    document = json.loads(text) | {"params": {"height_m": 3.0}}
    checker = Checker(built_in())
    folder = alone(json.dumps(document))
    assert sound(await checker.check(folder))
    swarm = [Platform("uav1", PlatformKind.UAV), Platform("uav2", PlatformKind.UAV)]
    assignment = assign(folder, swarm, {"height_m": height})
    if accepted:
        await checker.check_params(folder, assignment)
        return
    with pytest.raises(MissionError, match=r"height_m|/t/alt"):
        await checker.check_params(folder, assignment)


async def test_read_mission_is_known_under_any_name() -> None:
    checker, text = Checker(built_in()), net(s="Start>e", e="End")
    binding = Binding("uav1", PlatformKind.UAV, "r", "trial", {})
    assert checker.known(text, "m.json", binding) is None
    read = await checker.load(text, "m.json", binding)
    assert checker.known(text, "m.json", binding) is read
    elsewhere = checker.known(text, "elsewhere/m.json", binding)
    assert elsewhere is not None and (elsewhere.file, elsewhere.blocks) == ("elsewhere/m.json", read.blocks)
