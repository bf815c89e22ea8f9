"""The figures of share/doc/scale.md: outages, loops, complete boot storms; and the command of each row."""

import re
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from tests.simulation.directory import table
from tests.simulation.directory.flight import Outages
from tests.simulation.directory.storm import Storm
from tests.simulation.directory.swarm import Swarm

from swarmd.broker.core.swarm.routes.routing_table import RouteChanged

PAGE: Final = Path(__file__).parents[3] / "share/doc/scale.md"
ROW: Final = re.compile(r"^\| (\d+)\b.*\| `([a-z]+ [^`]*)` \|$", re.MULTILINE)


def test_each_row_of_page_is_computed_by_command() -> None:
    rows = ROW.findall(PAGE.read_text())
    assert rows
    for nodes, command in rows:
        options = table.parse(command.split())
        assert options.nodes in (None, int(nodes))


def test_a_size_that_no_table_has_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        table.parse(["moving", "--nodes", "17"])
    assert "--nodes 17" in capsys.readouterr().err


def test_outage_lasts_until_connected_pair_has_route() -> None:
    outages = Outages(2)
    yes, no = np.ones((2, 2), dtype=bool), np.zeros((2, 2), dtype=bool)
    one = np.array([[False, True], [False, False]])
    outages.look(one, no)
    outages.look(one, no)
    outages.look(yes, yes)
    assert outages.all_s() == [0.5]
    outages.look(one, no)
    assert sorted(outages.all_s()) == [0.25, 0.5], "one still lasts"
    outages.look(no, no)
    assert outages.all_s() == [0.5], "its pair was parted"


def test_looping_route_is_found_when_it_changes() -> None:
    swarm = Swarm(1, 16, speed_m_s=0.0)
    swarm.run_for(2.0)
    first, second, goal = (swarm.brokers[name] for name in swarm.names[:3])
    swarm.next_hop[1, 3] = 2
    with pytest.raises(AssertionError, match=r"loop at .* from uav2 towards uav3"):
        swarm.on_routes(second, [RouteChanged(goal.hw, first.hw)])


@pytest.mark.parametrize(("loss", "limit_s"), [(0.02, 3.0), (0.3, 6.0)])
def test_boot_storm_of_16_nodes_ends_in_seconds(loss: float, limit_s: float) -> None:
    storm = Storm(0, 16, loss=loss)
    assert not storm.is_complete()
    assert storm.converge_s() <= limit_s
    storm.run_for(3.0)
    assert storm.is_complete(), "links that came up stay up"
