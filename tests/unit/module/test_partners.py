"""Partners: units of other platforms from the board of the register, without a node."""

from typing import cast

import pytest

from swarmware.errors import NotFound
from swarmware.model.clock import Clock
from swarmware.module.board import BoardReader
from swarmware.module.partners import Partners
from swarmware.types.register import ApplicationTable, PartnerTable, PartnerUnit

S = 1_000_000_000
TABLE = PartnerTable(
    (
        PartnerUnit(ApplicationTable("uav1", "main", 1, 1, 1, "register#1", 0), 1, 90 * S),
        PartnerUnit(ApplicationTable("uav1", "payload", 1, 1, 1, "register#1", 0), 1, 110 * S, 98 * S),
        PartnerUnit(ApplicationTable("uav2", "main", 1, 1, 1, "register#1", 0), 2, 95 * S, 101 * S),
    )
)


class Board:
    """In place of the reader of the board."""

    value: PartnerTable | None = TABLE


class FixedClock:
    """A clock that stands at 100 s."""

    def now_ns(self) -> int:
        return 100 * S


@pytest.fixture
def partners() -> Partners:
    return Partners(cast(BoardReader[PartnerTable], Board()), cast(Clock, FixedClock()))


def test_each_partner_has_hops_age_and_outage(partners: Partners) -> None:
    found = [(one.platform, one.unit, one.hops, one.age_s, one.unreachable_s) for one in partners]
    assert found == [
        ("uav1", "main", 1, 10.0, None),
        ("uav1", "payload", 1, 0.0, 2.0),
        ("uav2", "main", 2, 5.0, 0.0),
    ]


def test_a_platform_has_its_own_units_only(partners: Partners) -> None:
    assert [one.unit for one in partners.of("uav1")] == ["main", "payload"]
    assert [one.platform for one in partners.of("uav2")] == ["uav2"]
    with pytest.raises(NotFound, match="partner uav9: not known; expected one of: uav1, uav2"):
        partners.of("uav9")
