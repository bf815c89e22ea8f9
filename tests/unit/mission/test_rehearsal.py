"""A platform reads its part of the stored missions before anybody orders one."""

import asyncio
from pathlib import Path

import pytest
from tests.unit.mission.manifests import AIR_AND_CONTROL
from tests.unit.mission.nets import net

from swarmd.mission import checking
from swarmd.mission.checking import Checker
from swarmd.mission.core.admission import OrderAdmission
from swarmd.mission.rehearsal import Rehearsal
from swarmd.mission.store import MissionStore
from swarmd.mission.values import Values
from swarmware.mission.assignment import Platform, assign
from swarmware.mission.catalogue import built_in
from swarmware.mission.check import check_text
from swarmware.mission.model import MissionDefinition
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.mission import MissionOrder

UAV1, UAV2, GCS = (
    Platform("uav1", PlatformKind.UAV),
    Platform("uav2", PlatformKind.UAV),
    Platform("gcs", PlatformKind.GCS),
)
MANIFEST = f"""
name = "climb"
{AIR_AND_CONTROL}"""
AIR = net(
    s="Start>a",
    a="Arm>t",
    t={"type": "Takeoff", "alt": "$param.height", "next": "l"},
    l="Land>e",
    e="End",
).replace(
    '{"mission"',
    '{"params": {"height": 1.0}, "requires": ["battery > 20 %", "age(/gcs/nav/pose) < 9"], "mission"',
    1,
)


def store(root: Path, checker: Checker, **missions: str) -> MissionStore:
    for name, air in missions.items():
        folder = root / "missions" / name
        folder.mkdir(parents=True)
        (folder / "mission.toml").write_text(MANIFEST, "utf-8")
        (folder / "air.json").write_text(air, "utf-8")
        (folder / "control.json").write_text(net(s="Start>e", e="End"), "utf-8")
    return MissionStore((root / "missions",), checker)


def unused(order: MissionOrder, mission: MissionDefinition) -> None:
    """Stands for the acceptance of orders."""


async def test_part_needs_exactly_two_equal_platforms(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("mission", node=node) as m:
        checker = Checker(built_in())
        rehearsal = Rehearsal("uav1", store(tmp_path, checker), checker, Values(m), unused)
        few, all_ = frozenset({UAV1}), frozenset({UAV1, UAV2})
        assert [rehearsal.due(now) for now in (few, all_, all_)] == [False, False, True]
        await rehearsal.play(all_)
        assert [rehearsal.due(now) for now in (all_, few, all_, few, few)] == [False] * 4 + [True]


async def test_order_of_stored_mission_is_answered_from_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with tmp_node(tmp_path) as node, Module("mission", node=node) as m:
        checker, values = Checker(built_in()), Values(m)
        missions = store(tmp_path, checker, broken="{", climb=AIR)
        await missions.list()
        accepted: list[MissionOrder] = []

        def rehearse(order: MissionOrder, mission: MissionDefinition) -> None:
            assert mission.blocks["t"].params.altitude_m == 6.5  # type: ignore[attr-defined]  # of a Takeoff
            accepted.append(order)

        await Rehearsal("uav2", missions, checker, values, rehearse).play(frozenset({GCS, UAV1, UAV2}))
        read: list[str] = []

        def seen(text: str, *others: object) -> object:
            read.append(text)
            return check_text(text, *others)  # type: ignore[arg-type]  # as it was called

        monkeypatch.setattr(checking, "check_text", seen)
        folder = missions.folder("climb")
        [order] = accepted
        binding = OrderAdmission("uav2", PlatformKind.UAV).verify(order, 0, order.expires_ns, "uav2")
        assert order.text == AIR and checker.known(AIR, "air.json", binding) is not None
        first, second, _ = assign(folder, [GCS, UAV1, UAV2], {}).member_assignments
        mission = await checker.load(AIR, "as the station calls it", second.binding)
        assert (read, mission.file) == ([], "as the station calls it")
        assert mission.blocks["t"].params.altitude_m == 6.5  # type: ignore[attr-defined]  # of a Takeoff
        await checker.load(AIR, "air.json", first.binding)  # the other platform's part
        assert read == [AIR]
        # what would have to be sent by another platform is not asked for yet
        await asyncio.sleep(0)
        assert not [path for path in m.entry.reads if path.startswith("/")]
        assert values.age_s("power/battery") is None
