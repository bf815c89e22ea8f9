"""What a navigator says decides by its error's kind how a motion ends; its words are for people."""

import msgspec
import pytest

from swarmd.mission.core.nav_fault import KINDS, NavFaultTimeouts
from swarmware.mission.catalogue import BLOCKS
from swarmware.types.navigation import NavError, NavState, NavStatus

S = 1_000_000_000
LIMITS = dict.fromkeys((NavError.NONE, NavError.NO_WAY, NavError.LEADER_LOST, NavError.NO_POSITION), 5.0)


def status(error: NavError, note: str = "", state: str = "holding") -> NavStatus:
    return NavStatus(1, NavState(state), note=note, error=error)


@pytest.mark.parametrize("error", [error for error in NavError if error is not NavError.NONE])
def test_each_error_ends_motion_after_its_time(error: NavError) -> None:
    timeouts = NavFaultTimeouts(LIMITS)
    limit_s = {NavError.DISARMED: 1, NavError.BAD_GOAL: 0}.get(error, 5)
    if limit_s:
        assert timeouts.lost(status(error), 0) is None
        assert timeouts.lost(status(error), limit_s * S - 1) is None
    assert timeouts.lost(status(error, "why"), limit_s * S) == (KINDS[error], f"{error.value}: why")


@pytest.mark.parametrize("note", ["disarmed", "leader_lost: ugv1", "blocked", "no_position"])
def test_words_of_a_note_decide_nothing(note: str) -> None:
    timeouts = NavFaultTimeouts(LIMITS)
    for second in range(20):
        assert timeouts.lost(status(NavError.NONE, note), second * S) is None


def test_another_error_and_good_word_begin_time_again() -> None:
    timeouts = NavFaultTimeouts(LIMITS)
    assert timeouts.lost(status(NavError.NO_WAY), 0) is None
    assert timeouts.lost(status(NavError.LEADER_LOST), 4 * S) is None
    assert timeouts.lost(status(NavError.LEADER_LOST), 8 * S) is None
    assert timeouts.lost(status(NavError.NONE), 8 * S) is None
    assert timeouts.lost(status(NavError.LEADER_LOST), 9 * S) is None


def test_blocked_without_a_reason_is_blocked() -> None:
    timeouts = NavFaultTimeouts(LIMITS)
    assert timeouts.lost(status(NavError.NONE, state="blocked"), 0) is None
    lost = timeouts.lost(status(NavError.NONE, state="blocked"), 5 * S)
    assert lost == ("blocked", "the navigator makes no progress")


def test_every_kind_is_in_motion_catalogue() -> None:
    assert KINDS.keys() == set(NavError)
    named = {kind for block in BLOCKS if block.motion for kind in block.errors}
    assert set(KINDS.values()) <= named


def test_unknown_navigator_error_fails_motion_alike() -> None:
    timeouts = NavFaultTimeouts(LIMITS)
    later = status(NavError("gripper_stuck"), "left finger")
    assert timeouts.lost(later, 0) is None
    assert timeouts.lost(msgspec.structs.replace(later, error=NavError("gripper_stuck")), 4 * S) is None
    assert timeouts.lost(later, 5 * S) == ("blocked", "gripper_stuck: left finger")
