"""Names, paths, patterns and ids."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import InvalidInput
from swarmware.model import names

SEGMENT = st.from_regex(r"[a-z0-9_]{1,8}", fullmatch=True)
LOCAL = st.lists(SEGMENT, min_size=1, max_size=5).map("/".join)
PLATFORM = st.from_regex(r"[a-z][a-z0-9_]{0,30}", fullmatch=True)


@pytest.mark.parametrize("path", ["nav/pose", "/uav3/nav/pose", "/uav3", "a", "sys/tree/get"])
def test_a_good_path_is_returned_as_it_is(path: str) -> None:
    assert names.check_path(path) == path


@pytest.mark.parametrize(
    ("path", "culprit"),
    [
        ("nav//pose", "''"),
        ("nav/Pose", "'Pose'"),
        ("/3uav/nav", "3uav"),
        ("nav/po se", "'po se'"),
        ("", "''"),
    ],
)
def test_bad_path_is_refused_with_segment(path: str, culprit: str) -> None:
    with pytest.raises(InvalidInput, match=culprit):
        names.check_path(path)


def test_path_too_long_for_file_name_is_refused() -> None:
    with pytest.raises(InvalidInput, match="at most 200"):
        names.check_path("a/" * 150 + "a")


@given(PLATFORM, LOCAL)
def test_join_and_split_are_inverse(platform: str, local: str) -> None:
    assert names.split(names.join(platform, local)) == (platform, local)
    assert names.split(local) == (None, local)


@pytest.mark.parametrize(
    ("pattern", "path", "matches"),
    [
        ("/*/nav/pose", "/uav1/nav/pose", True),
        ("/*/nav/pose", "/uav1/nav/poses", False),
        ("/*/nav/pose", "/uav1/x/nav/pose", False),
        ("/uav1/**", "/uav1/a/b/c", True),
        ("/uav1/**", "/uav1", True),
        ("/uav1/**", "/uav10/a", False),
        ("**", "nav/pose", True),
        ("/**", "/uav1/nav/pose", True),
        ("/{uav,ugv}*/nav/**", "/ugv12/nav/x", True),
        ("/{uav,ugv}*/nav/**", "/usv1/nav/x", False),
        ("nav/*", "nav/a/b", False),
        ("nav/p*e", "nav/pose", True),
        ("/uav1/nav/pose", "/uav1/nav/pose", True),
    ],
)
def test_patterns_match_one_segment_any_depth_and_alternatives(
    pattern: str, path: str, matches: bool
) -> None:
    assert names.Pattern(pattern).matches(path) is matches


@pytest.mark.parametrize("pattern", ["nav/{a", "nav/A", "nav/a b", "nav/(x)", "a}"])
def test_a_bad_pattern_is_refused_by_name(pattern: str) -> None:
    with pytest.raises(InvalidInput, match="pattern"):
        names.Pattern(pattern)


def test_alternatives_with_slash_are_refused_with_rule() -> None:
    with pytest.raises(InvalidInput, match=r"not closed in '\{nav'; expected '\}' in the same segment"):
        names.Pattern("/uav1/{nav/pose,sensor/imu}")


@given(LOCAL)
def test_path_is_pattern_that_matches_itself_only(local: str) -> None:
    pattern = names.Pattern(local)
    assert pattern.literal
    assert pattern.matches(local)
    assert not pattern.matches(local + "x")


@given(st.text(alphabet="ab/*{,}_", max_size=12), LOCAL)
def test_what_a_pattern_matches_starts_with_its_prefix(text: str, path: str) -> None:
    try:
        pattern = names.Pattern(text)
    except InvalidInput:
        return
    if pattern.matches(path) and not pattern.literal:
        assert path.startswith(pattern.prefix) or path + "/" == pattern.prefix


def test_ids_are_stable_and_depend_on_all() -> None:
    assert names.hardware_id("uav1") == names.hardware_id("uav1", "main")
    ids = {
        names.hardware_id("uav1"),
        names.hardware_id("uav2"),
        names.hardware_id("uav1", "fc1"),
        names.application_id("planner", 1),
        names.application_id("planner", 2),
        names.data_id("nav/pose", "Pose"),
        names.data_id("nav/pose", "Twist"),
    }
    assert len(ids) == 7
    assert all(0 < number < names.ANY for number in ids)
    assert names.hardware_id("uav1") == 0x023E3DC9  # on the wire: must never change


def test_platforms_sort_as_people_count() -> None:
    assert sorted(["uav10", "uav2", "ugv1", "gcs"], key=names.natural) == ["gcs", "uav2", "uav10", "ugv1"]


def test_address_is_platform_and_unit_main_unnamed() -> None:
    assert str(names.Address("uav3")) == "uav3"
    assert str(names.Address("uav3", "fc")) == "uav3.fc"
    assert names.Address.parse("uav3.main") == names.Address("uav3")
    assert names.Address.parse("uav3.main").path == "uav3.main"
    assert names.Address("uav3", "fc").hardware == names.hardware_id("uav3.fc")
    assert names.hardware_id("uav3.main") == names.hardware_id("uav3")
    for text in ("", "uav3.", ".fc", "uav3.fc.x", "uav3.Fc"):
        with pytest.raises(InvalidInput):
            names.Address.parse(text)


def test_path_may_name_computer_in_first_segment() -> None:
    assert names.split(names.check_path("/uav3.fc/nav/pose")) == ("uav3.fc", "nav/pose")
    for path in ("uav3.fc/nav/pose", "/uav3/nav.pose", "/uav3.fc.x/nav", "/uav3./nav"):
        with pytest.raises(InvalidInput):
            names.check_path(path)
    assert names.has_unit_branch("net/routes")
    assert names.has_unit_branch("sys/tree/get")
    assert not names.has_unit_branch("sys/mission/task")
    assert not names.has_unit_branch("nav/pose")


@pytest.mark.parametrize(
    ("text", "path", "field"),
    [
        ("nav/pose", "nav/pose", ""),
        ("nav/pose.x_m", "nav/pose", "x_m"),
        ("/uav3/nav/pose.x_m", "/uav3/nav/pose", "x_m"),
        ("/uav3.fc/nav/pose", "/uav3.fc/nav/pose", ""),
        ("/uav3.fc/nav/pose.x_m", "/uav3.fc/nav/pose", "x_m"),
        ("/uav3.fc/plan/path.steps.0", "/uav3.fc/plan/path", "steps.0"),
        ("/*/nav/pose.x_m", "/*/nav/pose", "x_m"),
        ("/uav3.fc", "/uav3.fc", ""),
        ("/uav3", "/uav3", ""),
        ("", "", ""),
    ],
)
def test_dot_of_computer_is_no_dot_before_field(text: str, path: str, field: str) -> None:
    assert names.split_field(text) == (path, field)
