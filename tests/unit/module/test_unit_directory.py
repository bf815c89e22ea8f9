"""Messages go to the computer of a platform that serves the path, as the table of partners has it."""

from pathlib import Path

import pytest

from swarmware.model.names import Address
from swarmware.module.module import Module
from swarmware.module.unit_directory import PATH, UnitDirectory
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.register import Application, ApplicationTable, PartnerTable, PartnerUnit


def unit(platform: str, name: str, *serves: str, lost_ns: int | None = None) -> PartnerUnit:
    application = Application("app", 1, 1, 1, "", 0, serves)
    return PartnerUnit(ApplicationTable(platform, name, 1, 1, 1, "m", 1, (application,)), 1, 1, lost_ns)


@pytest.mark.parametrize(
    ("own_unit", "platform", "path", "expected"),
    [
        ("main", "uav2", "cmd/attitude", "fc"),
        ("main", "uav2", "cmd/mission", "main"),
        ("main", "uav3", "cmd/mission", "nav"),
        ("main", "uav1", "cmd/attitude", "fc"),
        ("main", "uav1", "cmd/mission", None),
        ("nav", "uav1", "cmd/mission", "fc"),
        ("main", "uav9", "cmd/mission", None),
    ],
)
async def test_serving_unit_is_known_or_first_reachable(
    tmp_path: Path, own_unit: str, platform: str, path: str, expected: str | None
) -> None:
    name = str(Address("uav1", own_unit))
    async with tmp_node(tmp_path, name) as node, Module("register", node=node) as m:
        directory = UnitDirectory(node)
        assert not directory.has_several("uav2")
        board = m.writer(PATH, PartnerTable, link="request")
        board.write(
            PartnerTable(
                (
                    unit("uav1", "fc", "cmd/attitude"),
                    unit("uav2", "fc", "cmd/attitude"),
                    unit("uav2", "main"),
                    unit("uav3", "main", lost_ns=5),
                    unit("uav3", "nav"),
                    unit("uav4", "main", "cmd/attitude"),
                )
            )
        )
        assert [one for one in ("uav1", "uav2", "uav3", "uav4") if directory.has_several(one)] == [
            "uav1",
            "uav2",
            "uav3",
        ]
        found = directory.serving(platform, path)
        assert found == (None if expected is None else Address(platform, expected))
        directory.close()
