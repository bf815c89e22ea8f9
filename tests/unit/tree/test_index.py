"""The index: digest follows content, searches are by prefix and pattern, wrong paths get hints."""

import tracemalloc

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from swarmd.tree.core.structure.index import Index, Leaf, leaf
from swarmware.errors import InvalidInput
from swarmware.model.names import Pattern
from swarmware.model.resource import Resource


def board(path: str, **fields: object) -> Leaf:
    return leaf(Resource(path=path, type="Float", **fields))  # type: ignore[arg-type]


PATHS = [
    "app/a/status",
    "nav",
    "nav/goal",
    "nav/pose",
    "navigator",
    "power/battery",
    "sensor/range/front",
    "x",
]


def tree() -> Index:
    return Index(board(path) for path in PATHS)


def matching(pattern: str, after: str = "") -> list[str]:
    return [item.resource.path for item in tree().match(pattern, after=after)]


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("nav/pose", ["nav/pose"]),
        ("nav/none", []),
        ("nav/*", ["nav/goal", "nav/pose"]),
        ("nav/**", ["nav", "nav/goal", "nav/pose"]),
        ("nav*", ["nav", "navigator"]),
        ("**", PATHS),
        ("*", ["nav", "navigator", "x"]),
        ("**/pose", ["nav/pose"]),
        ("{nav,power}/*", ["nav/goal", "nav/pose", "power/battery"]),
        ("sensor/**/front", ["sensor/range/front"]),
    ],
)
def test_patterns_find_paths_in_order(pattern: str, expected: list[str]) -> None:
    assert matching(pattern) == expected


def test_a_search_goes_on_behind_a_path() -> None:
    assert matching("**", after="nav/goal") == PATHS[3:]
    assert matching("nav/**", after="nav") == ["nav/goal", "nav/pose"]
    assert matching("nav/pose", after="nav/pose") == []


def test_a_bad_pattern_is_refused() -> None:
    with pytest.raises(InvalidInput, match="pattern"):
        matching("nav/{pose")


def test_digest_depends_on_content_not_history() -> None:
    one, other = tree(), Index()
    for path in reversed(PATHS):
        other.put(board(path))
    assert one.digest == other.digest != 0
    assert one.put(board("new"))
    assert one.digest != other.digest
    assert one.remove("new")
    assert one.digest == other.digest


def test_search_finds_newest_leaf_and_copy_own() -> None:
    index = tree()
    twin = index.copy()
    assert index.put(board("nav/pose", unit="m"))
    assert [item.resource.unit for item in index.match("nav/p*")] == ["m"]
    assert [item.resource.unit for item in twin.match("nav/p*")] == [""]


def test_lost_is_part_of_the_content() -> None:
    resource = Resource(path="nav/pose", type="Pose")
    assert leaf(resource).mark != leaf(resource, lost=True).mark


def test_putting_the_same_changes_nothing_and_says_so() -> None:
    index = tree()
    digest = index.digest
    assert not index.put(board("nav/pose"))
    assert index.put(board("nav/pose", unit="m"))
    assert index.digest != digest
    assert not index.remove("nothing")


def test_a_copy_is_independent() -> None:
    index = tree()
    twin = index.copy()
    twin.remove("nav/pose")
    assert "nav/pose" in index
    assert "nav/pose" not in twin
    assert len(twin) == len(index) - 1


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("nav/poes", "nav/pose"),
        ("power/batery", "power/battery"),
        ("sensor/range/frnt", "sensor/range/front"),
    ],
)
def test_a_wrong_path_gets_a_hint(path: str, expected: str) -> None:
    assert expected in tree().near(path)


_segment = st.sampled_from(["a", "b", "ab", "c1"])
_path = st.lists(_segment, min_size=1, max_size=3).map("/".join)
_pattern = st.lists(st.sampled_from(["a", "*", "**", "a*", "{a,b}", "{ab,c}*"]), min_size=1, max_size=3).map(
    "/".join
)


@given(paths=st.sets(_path, max_size=12), pattern=_pattern, after=st.one_of(st.just(""), _path))
@example(paths={"a"}, pattern="a/**/**", after="")
def test_search_equals_exhaustive_path_scan(paths: set[str], pattern: str, after: str) -> None:
    index = Index(board(path) for path in paths)
    expected = sorted(path for path in paths if Pattern(pattern).matches(path) and path > after)
    assert [item.resource.path for item in index.match(pattern, after=after)] == expected


@given(
    changes=st.lists(st.tuples(st.booleans(), st.booleans(), _path), max_size=30),
    pattern=_pattern,
    after=st.one_of(st.just(""), _path),
)
def test_search_is_exact_after_any_changes(
    changes: list[tuple[bool, bool, str]], pattern: str, after: str
) -> None:
    first = Index([board("a"), board("b/a")])
    both = [first, first.copy()]
    for number, (add, which, path) in enumerate(changes):
        if add:
            both[which].put(board(path))
        else:
            both[which].remove(path)
        if number % 5 == 4:
            both[0] = both[1].copy()
    for index in both:
        paths = {item.resource.path for item in index}
        expected = sorted(path for path in paths if Pattern(pattern).matches(path) and path > after)
        assert [item.resource.path for item in index.match(pattern, after=after)] == expected


@given(st.lists(st.tuples(st.booleans(), _path), max_size=30))
def test_digest_equals_fresh_index_after_changes(changes: list[tuple[bool, str]]) -> None:
    index = Index()
    for step, (add, path) in enumerate(changes):
        if step % 3 == 0:
            list(index.match("**"))
        if add:
            index.put(board(path))
        else:
            index.remove(path)
    assert index.digest == Index(index).digest
    assert [item.resource.path for item in index.match("**")] == sorted(item.resource.path for item in index)


def test_search_in_hundred_thousand_visits_few(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    index = Index(board(f"unit{i // 100}/value{i % 100}") for i in range(100_000))
    looked: list[str] = []
    matches = Pattern.matches

    def counting(pattern: Pattern, path: str) -> bool:
        looked.append(path)
        return matches(pattern, path)

    monkeypatch.setattr(Pattern, "matches", counting)
    index.put(board("unit5/extra/deep"))
    for pattern, found, at_most in (
        ("unit500/*", 100, 0),
        ("unit500/**", 100, 0),
        ("*/value7", 1000, 0),
        ("**/deep", 1, 0),
        ("**/extra/*", 1, 0),
        ("unit5*/value7", 111, 1000),
        ("{unit5,unit6}/value*7", 20, 1200),
    ):
        looked.clear()
        assert len(list(index.match(pattern))) == found
        assert len(looked) <= at_most, pattern


def test_copies_share_the_branches_that_neither_has_changed() -> None:
    template = Index(board(f"group{i // 20}/value{i % 20}") for i in range(500))
    copies = [template.copy() for _ in range(50)]
    for number, one in enumerate(copies):
        one.put(board(f"group1/own{number}"))
    tracemalloc.start()
    try:
        further = template.copy()
        before, _ = tracemalloc.get_traced_memory()
        further.put(board("group2/own"))
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 8_000, "the root and one branch"
    assert [len(list(one.match("group1/*"))) for one in copies] == [21] * 50
    assert len(list(template.match("group1/*"))) == 20
