"""The runs of missions through the daemons and the commands: listed, shown, and their part of the log."""

import json
import time
from pathlib import Path

from tests.integration.cli.conftest import Ctl, Lab
from tests.patience import PATIENCE_S

MISSION = {
    "title": "Wait a moment",
    "params": {"pause_s": 5.0},
    "mission": {
        "b0": {"type": "Start", "next": "b1"},
        "b1": {"type": "Wait", "s": "$param.pause_s", "next": "b2"},
        "b2": {
            "type": "Decision",
            "cases": [{"if": "own/weather.temp_degc > 10", "next": "b3"}],
            "next": "b3",
            "on": {"unknown_value": "b3"},
        },
        "b3": {"type": "End"},
    },
}


def test_run_is_listed_shown_and_queried(ctl: Ctl, lab: Lab, tmp_path: Path) -> None:
    file = tmp_path / "pause.json"
    file.write_text(json.dumps(MISSION))
    begin = f"mission start {file} --member ugv1 --member uav1 --set pause_s=0.3 --yes --json"
    run_id = ctl(begin).document["epoch"]
    ends_s = time.monotonic() + PATIENCE_S
    while (listed := ctl("mission history -n ugv1 --json").document["runs"])[0]["outcome"] == "open":
        assert time.monotonic() < ends_s
    assert (listed[0]["epoch"], listed[0]["outcome"]) == (run_id, "done")
    both = ctl(f"mission history --show {run_id} -n '*' --json")
    assert "left out, without such a resource: gcs, uav2" in both.err
    nodes = {one["platform"]: one["result"] for one in both.document["nodes"]}
    assert set(nodes) == {"uav1", "ugv1"}
    shown = nodes["ugv1"]
    assert json.loads(shown["document"]) == MISSION
    assert shown["record"]["params"] == {"pause_s": 0.3}
    assert "own/weather" in shown["record"]["findings"][0]
    assert shown["record"]["ordered_by"].endswith("@gcs")
    assert [(step["block"], step["event"]) for step in shown["progress"]][-1] == ("", "state:done")
    assert shown["record"]["log"]["segments"]
    for_people = ctl(f"mission history --show {run_id} -n ugv1").out
    assert "pause_s" in for_people and "b1" in for_people
    assert str(run_id) in ctl("mission history -n ugv1").out

    ends_s = time.monotonic() + PATIENCE_S
    query = f"log query /ugv1/mission/progress --mission {run_id} --json"
    while "state:done" not in (entries := ctl(query)).out:
        assert time.monotonic() < ends_s, "the logger writes each second"
    assert {line["value"]["epoch"] for line in entries.lines} == {run_id}
    own = shown["record"]["log"]
    of_all = ctl(f"log query --mission {run_id} --json").lines
    assert {line["path"].split("/")[1] for line in of_all} >= {"ugv1", "uav1", "gcs"}
    first_utc_ns, last_utc_ns = int(own["first_utc_ns"]), int(own["last_utc_ns"])
    assert all(int(line["utc_ns"]) - first_utc_ns > -1e9 for line in of_all)
    assert all(int(line["utc_ns"]) - last_utc_ns < 3e9 for line in of_all)
    none = ctl("log query --mission 1")
    assert (none.code, "run 1: not recorded by the nodes" in none.err) == (6, True)
    assert ctl("mission history --show 1 -n ugv1").code == 6
