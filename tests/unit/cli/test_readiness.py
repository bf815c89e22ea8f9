"""`swarmctl health ready`: vehicles that are ready, are not, are silent, or have no monitor any more."""

from typing import Any

import msgspec
import pytest
from tests.unit.cli.session import COPY, ScriptedSession

from swarmctl.commands.health import readiness
from swarmctl.commands.health.readiness import show_readiness
from swarmware.errors import InvalidInput, NoAnswer, NotFound, Partial, SwarmError
from swarmware.model.platform_kind import PlatformKind
from swarmware.types import registry
from swarmware.types.health import NotReady, Readiness
from swarmware.types.tree import Quality, TreeValue

READY = Readiness(True, (), ("estimator", "faults"))
LOW = Readiness(
    False, (NotReady("battery", "0.12"), NotReady("faults", "app/sim=died")), ("battery", "faults")
)


class Vehicles(ScriptedSession):
    """Vehicles, of which each has this readiness, that age of it, or an error."""

    def __init__(
        self,
        found: dict[str, Readiness | SwarmError],
        *,
        age_s: float = 0.2,
        quality: Quality = Quality.LIVE,
        node: str = "",
        output: str = "json",
    ) -> None:
        answers: dict[str, Any] = {}
        for name, one in found.items():
            path = f"/{name}/health/ready"
            value = one
            if isinstance(one, Readiness):
                value = TreeValue(path, "Readiness", registry.encode(one), 1, 1, 1, age_s, quality)  # type: ignore[assignment]
            answers[f"{COPY} {path}"] = value
        super().__init__(answers, node=node, output=output)
        self.names = ["gcs", *found]

    async def platforms(self) -> list[str]:
        return self.names

    async def in_reach(self, platform: str) -> bool:
        return True

    async def reach(self, platform: str) -> None:
        assert platform in self.names

    async def ask(self, path: str, value: Any, reply: Any, *, about: str = "", **others: Any) -> Any:
        """The owner has the same value as the copy."""
        return await super().ask(COPY, value, reply, about=about, **others)


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    async def kinds(session: Vehicles) -> dict[str, PlatformKind]:
        return {
            name: PlatformKind.GCS if name == "gcs" else PlatformKind.UAV
            for name in await session.platforms()
        }

    monkeypatch.setattr(readiness, "kinds", kinds)


async def test_all_ready_nodes_are_listed_with_checks() -> None:
    session = Vehicles({"uav1": READY, "uav2": READY}, output="table")
    await show_readiness(session)
    lines = session.stdout.getvalue().splitlines()
    assert [line.split()[:2] for line in lines[1:]] == [["uav1", "yes"], ["uav2", "yes"]]
    assert "estimator, faults" in lines[1]


async def test_warnings_follow_and_do_not_refuse() -> None:
    warned = msgspec.structs.replace(READY, warnings=(NotReady("realtime", "hal/realtime=refused"),))
    session = Vehicles({"uav1": warned}, output="table")
    await show_readiness(session)
    lines = session.stdout.getvalue().splitlines()
    assert [line.split() for line in lines[2:]] == [["uav1", "warning", "realtime", "hal/realtime=refused"]]


async def test_unready_nodes_are_partial_success_by_line() -> None:
    session = Vehicles({"uav1": READY, "uav2": LOW}, output="table")
    with pytest.raises(Partial, match=r"^not ready: uav2$"):
        await show_readiness(session)
    lines = [line.split() for line in session.stdout.getvalue().splitlines()[2:]]
    assert lines == [["uav2", "no", "battery", "0.12"], ["uav2", "no", "faults", "app/sim=died"]]


async def test_none_that_is_ready_is_a_failure() -> None:
    session = Vehicles({"uav1": LOW})
    with pytest.raises(SwarmError, match=r"^not ready: uav1$") as caught:
        await show_readiness(session)
    assert caught.value.exit_code == 1
    (row,) = session.document["vehicles"]
    assert row["not_ready"][0] == {"item": "battery", "reason": "0.12"}


@pytest.mark.parametrize(("age_s", "quality"), [(12.0, Quality.LIVE), (2.0, Quality.LOST)])
async def test_a_readiness_that_is_not_repeated_is_unknown(age_s: float, quality: Quality) -> None:
    session = Vehicles({"uav1": READY}, age_s=age_s, quality=quality)
    with pytest.raises(SwarmError, match="not ready: uav1"):
        await show_readiness(session)
    (row,) = session.document["vehicles"]
    assert (row["ready"], row["not_ready"][0]["reason"]) == (None, f"no health/ready for {age_s:.0f} s")


async def test_a_vehicle_without_a_monitor_is_unknown() -> None:
    session = Vehicles({"uav1": NotFound("/uav1/health/ready: no value yet")}, node="uav1")
    with pytest.raises(SwarmError, match="not ready: uav1") as caught:
        await show_readiness(session)
    assert caught.value.exit_code == 1
    (row,) = session.document["vehicles"]
    assert row["not_ready"][0]["reason"] == "no health/ready; expected it of the service health"


async def test_silent_node_is_named_and_alone_error() -> None:
    silent = NoAnswer("uav2: no route")
    session = Vehicles({"uav1": READY, "uav2": silent}, output="table")
    with pytest.raises(Partial, match="not ready: uav2"):
        await show_readiness(session)
    assert "uav2: no route" in session.stderr.getvalue()
    assert session.stdout.getvalue().splitlines()[2].split()[:2] == ["uav2", "silent"]
    with pytest.raises(NoAnswer, match="no route"):
        await show_readiness(Vehicles({"uav2": silent}, node="uav2"))


async def test_swarm_without_vehicles_has_no_readiness() -> None:
    with pytest.raises(InvalidInput, match="gcs: a ground station; expected a vehicle"):
        await show_readiness(Vehicles({"uav1": READY}, node="gcs"))
    with pytest.raises(NotFound, match="no vehicle is known to gcs"):
        await show_readiness(Vehicles({}))
