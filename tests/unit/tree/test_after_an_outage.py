"""What a subscriber gets first that is reachable again."""

from tests.unit.tree.pair import Pair, core, value

from swarmware.model.resource import Resource


def test_newest_board_value_goes_first_after_outage() -> None:
    boards = tuple(Resource(path=f"power/{name}", type="Float", owner="hal") for name in "abc")
    both = Pair(core("gcs", boards, templates=(boards,)), core("uav1", boards, templates=(boards,)))
    both.trees["gcs"].on_applications([], ["/uav1/power/*"], 0)
    both.meet()
    both.carry()
    uav = both.trees["uav1"]
    uav.on_gone("gcs", 0)
    for path, sequence in (("power/a", 4), ("power/a", 5), ("power/c", 7), ("power/b", 6)):
        uav.on_values([value(path, sequence, sequence)], 0)
    both.meet()
    both.carry()
    assert [item.sequence for item in both.received["gcs"]] == [7, 6, 5]
    for sequence, path in enumerate(("power/b", "power/a", "power/c"), 10):
        uav.on_values([value(path, sequence, sequence)], 0)
    both.wait(5)
    late = [item.sequence for item in both.received["gcs"][3:]]
    assert sorted(late) == [10, 11, 12]
    assert late != [12, 11, 10], "afterwards each has its turn"
