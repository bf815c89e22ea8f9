"""The journal has every kind of refused input, and few lines of it."""

import pytest

from swarmd.broker.core.reports.report import LOG_NS, RefusalLine, RefusalLog
from swarmware.types.traffic import CERTAINLY_HOSTILE, HOSTILE, Refused


@pytest.mark.parametrize("name", HOSTILE)
def test_each_kind_of_refusal_is_logged_first_time(name: str) -> None:
    line = RefusalLog().on_counters(Refused(**{name: 3}), 0)
    assert line == RefusalLine(name in CERTAINLY_HOSTILE, f"refused input: 3 {name}")


def test_thousand_refusals_make_one_line_per_minute() -> None:
    one, lines = RefusalLog(), []
    for number in range(1, 1001):
        line = one.on_counters(Refused(forged=number), number * LOG_NS // 400)
        lines += [] if line is None else [line.text]
    assert lines == [f"refused input: {count} forged" for count in (1, 400, 400)]


def test_nothing_new_is_not_logged() -> None:
    one = RefusalLog()
    assert one.on_counters(Refused(), 0) is None
    assert one.on_counters(Refused(looped=5, no_route=7, unknown_session=9), 0) is None, "no hostile input"
    one.on_counters(Refused(replayed=1), 0)
    assert one.on_counters(Refused(replayed=1), 10 * LOG_NS) is None


def test_duplicates_of_poor_link_do_not_hide_forger() -> None:
    one = RefusalLog()
    assert one.on_counters(Refused(replayed=2), 0) == RefusalLine(False, "refused input: 2 replayed")
    assert one.on_counters(Refused(replayed=4), 1) is None
    line = one.on_counters(Refused(replayed=5, forged=1), 2)
    assert line == RefusalLine(True, "refused input: 1 forged, 3 replayed")
