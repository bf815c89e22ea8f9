"""An address that several applications claim goes to one by the owner of the file, then by age."""

import pytest

from swarmware.model.names import data_id
from swarmware.transport.appfile.claims import AddressClaims, LivingApplication
from swarmware.transport.appfile.entry import AppEntry, Served

NODE, MEMBER, OTHER = 990, 1001, 1002


def app(
    name: str, uid: int, *addresses: str, started_ns: int = 100, pid: int = 7, instance: int = 1
) -> LivingApplication:
    served = tuple(Served(path=path, type="Goal", kind="request") for path in addresses)
    entry = AppEntry(
        name=name,
        instance=instance,
        pid=pid,
        pid_start=1,
        endpoint=f"ipc:///{name}",
        started_ns=started_ns,
        serves=served,
    )
    return LivingApplication(entry, uid, is_own=uid == NODE)


CASES: dict[str, tuple[str, list[LivingApplication], str | None]] = {
    "an order to a daemon is not for a member": (
        "sys/tree/set",
        [app("tree", NODE, "sys/tree/set"), app("zzz", MEMBER, "sys/tree/set", started_ns=1)],
        "tree",
    ),
    "not even while the daemon does not run": ("sys/tree/set", [app("zzz", MEMBER, "sys/tree/set")], None),
    "nor a command": ("cmd/abort", [app("aaa", MEMBER, "cmd/abort")], None),
    "elsewhere the node's user precedes": (
        "survey/plan",
        [app("a", MEMBER, "survey/plan", started_ns=1), app("b", NODE, "survey/plan", started_ns=2)],
        "b",
    ),
    "then the older claim": (
        "survey/plan",
        [app("b", MEMBER, "survey/plan", started_ns=2), app("a", OTHER, "survey/plan", started_ns=1)],
        "a",
    ),
    "whatever the order of names": (
        "survey/plan",
        [app("a", MEMBER, "survey/plan", started_ns=2), app("b", OTHER, "survey/plan", started_ns=1)],
        "b",
    ),
    "a member serves paths of its own": ("survey/plan", [app("a", MEMBER, "survey/plan")], "a"),
}


@pytest.mark.parametrize("case", CASES)
def test_one_claim_counts_and_every_other_is_named(case: str) -> None:
    path, applications, expected = CASES[case]
    claims = AddressClaims(applications)
    number = data_id(path, "Goal")
    for found in (claims.of_path(path), claims.of_data_id(number)):
        assert (None if found is None else found[0].name) == expected
    assert claims.serving_endpoints.get(number) == (None if expected is None else f"ipc:///{expected}")
    losers = [one.entry.id for one in applications if one.entry.name != expected]
    assert len(claims.refused) == len(losers)
    for line, loser in zip(claims.refused, losers, strict=True):
        assert line.startswith(f"{loser} of user ")
        assert f" claims {path}: served by " in line


def test_many_claims_of_one_application_are_one_line() -> None:
    claims = AddressClaims(
        [app("zzz", MEMBER, *(f"sys/tree/{number}" for number in range(8)), "survey/plan")]
    )
    assert claims.refused == (
        "zzz#1 of user 1001 claims sys/tree/0, sys/tree/1, sys/tree/2 and 5 more:"
        " served by the user of the node alone",
    )
    assert claims.of_path("survey/plan") is not None


def test_known_claim_prevails_over_stated_older_start() -> None:
    first = app("b", MEMBER, "survey/plan", started_ns=50)
    before = AddressClaims([first])
    rival = app("a", OTHER, "survey/plan", started_ns=1)
    claims = AddressClaims([rival, first], before)
    assert claims.of_path("survey/plan") == (first.entry, first.entry.serves[0])
    restarted = app("b", MEMBER, "survey/plan", started_ns=50, pid=8)
    claims = AddressClaims([rival, restarted], before)
    assert claims.of_path("survey/plan") == (rival.entry, rival.entry.serves[0])


def test_member_does_not_take_number_of_application(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(AppEntry, "app_id", 5)  # two names with one number
    for order in (1, -1):
        both = [app("tree", NODE), app("collision", MEMBER)][::order]
        claims = AddressClaims(both)
        found = claims.application(5)
        assert found is not None
        assert found.name == "tree"
        assert claims.endpoints == {5: "ipc:///tree"}


def test_member_does_not_take_number_of_address(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Served, "data_id", 9)
    claims = AddressClaims([app("tree", NODE, "sys/tree/set"), app("zzz", MEMBER, "collision")])
    found = claims.of_data_id(9)
    assert found is not None
    assert found[1].path == "sys/tree/set"


def test_applications_of_the_node_come_first() -> None:
    claims = AddressClaims([app("aaa", MEMBER), app("zzz", NODE), app("bbb", OTHER), app("yyy", NODE)])
    assert [entry.name for entry in claims.of_node] == ["zzz", "yyy"]
    assert [entry.name for entry in claims.entries] == ["zzz", "yyy", "aaa", "bbb"]
