"""Who could take part in a mission, and who is known but could not."""

import msgspec
import pytest

from swarmd.mission.core.census import FIRST_STATE_NS, Census
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionPhase, MissionState

S = 1_000_000_000
IDLE = MissionState(0, "", MissionPhase.IDLE, kind=PlatformKind.UAV)


def why(census: Census, now_ns: int) -> dict[str, str]:
    return {left.platform: left.why for left in census.absent(now_ns)}


def test_who_was_heard_lately_is_present() -> None:
    census = Census("gcs", 3 * S)
    census.on_state("uav1", IDLE, 10 * S)
    assert census.present(13 * S) == {"uav1": IDLE}
    assert census.absent(13 * S) == []


def test_a_way_to_a_platform_keeps_it_present() -> None:
    census = Census("gcs", 3 * S)
    census.on_state("uav1", IDLE, 10 * S)
    census.on_reachable("uav1", 20 * S)
    assert census.present(22 * S) == {"uav1": IDLE}


def test_silent_platform_is_lost_with_since_when() -> None:
    census = Census("gcs", 3 * S)
    census.on_state("uav1", IDLE, 10 * S)
    census.on_reachable("uav1", 12 * S)
    assert census.present(15 * S + 1) == {}
    assert why(census, 32 * S) == {"uav1": "lost: no beacon for 20 s"}


def test_platform_without_mission_daemon_is_reported() -> None:
    census = Census("gcs", 3 * S)
    census.on_reachable("relay", 10 * S)
    assert why(census, 11 * S) == {"relay": "no state of its mission daemon was received"}
    assert why(census, 20 * S) == {"relay": "out of reach"}


@pytest.mark.parametrize("heard", [False, True])
def test_roster_only_member_is_known(heard: bool) -> None:
    census = Census("gcs", 3 * S)
    census.roster = frozenset({"gcs", "uav1"})
    if heard:
        census.on_state("uav1", IDLE, 10 * S)
    assert list(why(census, 11 * S)) == ([] if heard else ["uav1"])


def test_first_state_is_awaited_for_while() -> None:
    census = Census("gcs", 3 * S)
    assert census.first_state_until_ns(10 * S) == 0
    census.on_reachable("gcs", 10 * S)
    census.on_reachable("uav1", 10 * S)
    census.on_reachable("uav2", 11 * S)
    census.on_reachable("uav1", 11 * S)
    assert census.first_state_until_ns(11 * S) == 11 * S + FIRST_STATE_NS
    census.on_state("uav2", IDLE, 11 * S)
    assert census.has_states
    assert census.first_state_until_ns(11 * S) == 10 * S + FIRST_STATE_NS
    assert census.first_state_until_ns(15 * S) == 0, "it is out of reach again"


def test_member_stating_run_has_its_epoch() -> None:
    census = Census("gcs", 3 * S)
    census.on_state("uav1", MissionState(7, "h", MissionPhase.READY, kind=PlatformKind.UAV), 10 * S)
    census.on_state("uav2", IDLE, 10 * S)
    census.on_state("uav3", MissionState(6, "h", MissionPhase.DONE, kind=PlatformKind.UAV), 10 * S)
    assert census.in_run(7) == ["uav1"]


def test_drained_platform_is_present_but_excluded() -> None:
    census = Census("gcs", 3 * S)
    census.on_state("uav1", msgspec.structs.replace(IDLE, drained_by="ann@gcs"), 10 * S)
    census.on_state("uav2", IDLE, 10 * S)
    assert set(census.present(11 * S)) == {"uav1", "uav2"}
    assert why(census, 11 * S) == {"uav1": "drained by ann@gcs; `swarmctl node undrain` ends it"}
    assert why(census, 20 * S)["uav1"].startswith("lost")
