"""A broker that starts again: how long it waits until nobody sends through its former session any more."""

from pathlib import Path
from typing import Final

import pytest

from swarmd.broker.core.beacon.beacon import NEVER_NS, Echo, Header, Hello, PlatformCode
from swarmd.broker.core.beacon.declared_period import CEILINGS_NS, LOWER_NS, DeclaredPeriod, ceiling_ns
from swarmd.broker.core.swarm.links.link import LinkState
from swarmd.broker.core.swarm.neighbour import FIRST_PERIOD_NS, NOTICE_SLACK_NS, notice_ns
from swarmd.broker.core.swarm.neighbours.neighbour_table import NeighbourTable
from swarmd.broker.records.session_store import PERIOD, SESSION, SessionStore
from swarmware.transport.security.seal import SESSION_MARK

MS: Final = 1_000_000
SECOND: Final = 1000 * MS
ME, PEER = 1, 2


@pytest.mark.parametrize("period_ms", [100, 450, 500, 2000, 10_000])
@pytest.mark.parametrize("every", [1, 2, 3, 5])
@pytest.mark.parametrize("others", [0, 300])
def test_no_link_outlives_the_notice_whatever_its_loss(period_ms: int, every: int, others: int) -> None:
    """`every`: of this number of datagrams, one arrives."""
    table = NeighbourTable(ME, SECOND)
    now_ns = 0
    for hw in range(100, 100 + others):
        table.on_header(Header(0, hw, 1, 0), False, ("h", 1), now_ns, [])
    for sequence in range(1, 200, every):
        now_ns = sequence * period_ms * MS
        header = Header(0, PEER, sequence, now_ns // 1000 & 0xFFFF_FFFF)
        neighbour = table.on_header(header, False, ("h", 1), now_ns, [])
        assert neighbour is not None
        table.on_hello(
            neighbour, header, Hello(1, 0, 1, 0, 0, PlatformCode.UAV, "uav2", b"", period_ms, 9999)
        )
        table.sent(sequence, now_ns - 2 * MS)
        table.on_echoes(neighbour, header, (Echo(ME, sequence & 0xFF, 1000, 255),), now_ns, [])
    assert [each.state for each in table.all() if each.hw == PEER] == [LinkState.UP]
    table.advance(now_ns + notice_ns(period_ms * MS, SECOND) - NOTICE_SLACK_NS)
    assert table.up() == []


def test_links_without_hello_end_within_shortest_notice() -> None:
    table = NeighbourTable(ME, SECOND)
    neighbour = table.on_header(Header(0, PEER, 1, 0), False, ("h", 1), 0, [])
    assert neighbour is not None
    assert neighbour.deadline_ns <= notice_ns(1, SECOND) - NOTICE_SLACK_NS
    assert neighbour.deadline_ns >= FIRST_PERIOD_NS


@pytest.mark.parametrize(
    ("period_ms", "kept_ms"), [(1, 125), (125, 125), (126, 250), (500, 500), (501, 1000), (60_000, 10_000)]
)
def test_periods_are_kept_in_classes(period_ms: int, kept_ms: int) -> None:
    assert ceiling_ns(period_ms * MS) == kept_ms * MS


def test_slower_period_is_kept_at_once() -> None:
    declared_period = DeclaredPeriod(0, 0)
    steps = [
        (0, 100, True, 125),
        (1, 110, False, 125),
        (2, 500, True, 500),
        (3, 100, False, 500),
        (4, 240, False, 500),
        (2 + LOWER_NS // SECOND - 1, 100, False, 500),
        (2 + LOWER_NS // SECOND, 100, True, 250),
        (3 + LOWER_NS // SECOND, 2000, True, 2000),
    ]
    for at_s, period_ms, keep, kept_ms in steps:
        assert declared_period.declare(period_ms * MS, at_s * SECOND) is keep, at_s
        assert declared_period.ns == kept_ms * MS


def test_period_of_former_session_holds_until_replaced() -> None:
    declared_period = DeclaredPeriod(2000 * MS, 0)
    assert not declared_period.declare(100 * MS, SECOND)
    assert declared_period.ns == 2000 * MS
    assert declared_period.declare(100 * MS, LOWER_NS)
    assert declared_period.ns == 125 * MS


def test_kept_session_exists_at_next_start(tmp_path: Path) -> None:
    first = SessionStore(tmp_path)
    assert first.declared_period_ns == 0, "nobody can know a former session"
    assert first.next_session(100) == 1 << 16
    first.keep(2000 * MS)
    second = SessionStore(tmp_path)
    assert second.declared_period_ns == 2000 * MS
    assert second.next_session(50) == 2 << 16
    assert sorted(path.name for path in tmp_path.iterdir()) == [PERIOD, SESSION]


def test_session_has_swarms_mark_and_rises(tmp_path: Path) -> None:
    wall_ns = 1_790_000_000_123_456_789
    sessions = [SessionStore(tmp_path).next_session(wall_ns, mark) for mark in (0xAB12, 0xAB12, 5, 0xFFFF)]
    assert [session & SESSION_MARK for session in sessions] == [0xAB12, 0xAB12, 5, 0xFFFF]
    assert sorted(set(sessions)) == sessions
    assert abs(sessions[0] - wall_ns) <= SESSION_MARK
    assert sessions[-1] < wall_ns + 4 * (SESSION_MARK + 1)


def test_node_without_former_data_waits_like_idle(tmp_path: Path) -> None:
    idle = tmp_path / "idle"
    idle.mkdir()
    SessionStore(idle).next_session(1)
    SessionStore(idle).keep(500 * MS)
    assert (
        SessionStore(tmp_path).quiet_ns(SECOND)
        == SessionStore(idle).quiet_ns(SECOND)
        == notice_ns(500 * MS, SECOND)
    )
    SessionStore(idle).keep(2000 * MS)
    assert SessionStore(idle).quiet_ns(SECOND) == notice_ns(2000 * MS, SECOND)


@pytest.mark.parametrize("content", [b"", b"x", b"\xff\xfe", b"0", b"77", b"-500", b"9" * 5000, b"5\n0"])
def test_a_damaged_period_counts_as_the_longest(tmp_path: Path, content: bytes) -> None:
    SessionStore(tmp_path).next_session(1)
    (tmp_path / PERIOD).write_bytes(content)
    assert SessionStore(tmp_path).declared_period_ns == CEILINGS_NS[-1]


def test_session_of_version_without_periods_counts_as_idle(tmp_path: Path) -> None:
    SessionStore(tmp_path).next_session(1)
    assert SessionStore(tmp_path).declared_period_ns == 500 * MS


def test_period_that_cannot_be_kept_is_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    former = SessionStore(tmp_path / "gone")
    former.keep(500 * MS)
    assert "broker.period: cannot be written" in caplog.text


def test_nothing_kept_and_no_time_gone() -> None:
    assert DeclaredPeriod(0, NEVER_NS).declare(100 * MS, 0)
