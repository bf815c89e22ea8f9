"""A vehicle of a lab with three computers: estimator, guidance and mission each on its own, and it flies."""

import json
import subprocess
import time
from collections.abc import Callable

from tests.patience import PATIENCE_S

from swarmctl.session import labs

Done = subprocess.CompletedProcess[str]
Ctl = Callable[..., Done]


def until_main_knows_the_others(ctl: Ctl) -> None:
    """The computer with the mission knows what the others serve: a lab is up when its ground station is."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        units = json.loads(ctl("app", "ls", "-n", "uav1", "--json").stdout)["units"]
        if {"main", "nav", "fc"} <= {unit["table"]["unit"] for unit in units}:
            return
        assert time.monotonic() < end_s, units


def test_vehicle_of_three_computers_takes_off_and_lands(ctl: Ctl, labs_folder: object) -> None:
    ctl("lab", "up", "formation", "--nodes", "3", "--units", "uav1", "--detach")
    names = [node.platform for node in labs.find().nodes]
    assert names == ["gcs", "ugv1", "uav1", "uav1.nav", "uav1.fc"]
    clocks = {node.offset_s for node in labs.find().nodes}
    assert len(clocks) == len(names), "each computer has its own clock"

    until_main_knows_the_others(ctl)
    (flown,) = json.loads(ctl("takeoff", "uav1", "--json").stdout)["vehicles"]
    assert flown["platform"] == "uav1"
    for path, unit in (("nav/pose", "nav"), ("nav/status", "fc"), ("mission/state", "main")):
        one = json.loads(ctl("tree", "get", f"/uav1.{unit}/{path}", "--json").stdout)
        whole = json.loads(ctl("tree", "get", f"/uav1/{path}", "--json").stdout)
        assert one["type"] == whole["type"], "the computer that provides it, and the platform"
    height_m = json.loads(ctl("tree", "get", "/uav1/nav/pose", "--json").stdout)["value"]["z_m"]
    truth_m = json.loads(ctl("tree", "get", "/uav1/sim/truth", "--json").stdout)["value"]["z_m"]
    assert height_m > 2.0
    assert abs(height_m - truth_m) < 0.5

    rows = json.loads(ctl("node", "ls", "--units", "-n", "uav1", "--json").stdout)["units"]
    assert [(one["unit"], one["answers"]) for one in rows] == [("main", True), ("fc", True), ("nav", True)]
    assert ["estimator" in one["info"]["services"] for one in rows] == [False, False, True]
    (alone,) = json.loads(ctl("node", "ls", "--units", "-n", "uav1.fc", "--json").stdout)["units"]
    assert alone["unit"] == "fc"
    counts = [one["health"]["state"]["apps_alive"] for one in rows]
    (whole_health,) = json.loads(ctl("health", "ls", "-n", "uav1", "--json").stdout)["platforms"]
    assert whole_health["state"]["apps_alive"] > max(counts), "of all its computers"
    rules = json.loads(ctl("tree", "rule", "-n", "uav1.fc", "--json").stdout)
    assert rules["rules"] == []
    ctl("tree", "log", "-n", "uav1.fc", "--json")
    there = json.loads(ctl("link", "ls", "-n", "uav1.nav", "--json").stdout)
    assert {"main", "fc"} <= {one["unit"] for one in there["neighbours"] if one["platform"] == "uav1"}

    changed = json.loads(ctl("config", "set", "navigator/altitude_kp", "1.5", "-n", "uav1", "--json").stdout)
    assert changed["applied_by"] == ["guidance"], "the module that flies with it, on another computer"
    assert ctl("config", "get", "navigator/altitude_kp", "-n", "uav1").stdout == "1.5\n"
    for record in (("config", "history"), ("tree", "log")):
        changes = json.loads(ctl(*record, "-n", "uav1", "--json").stdout)["changes"]
        assert [one["after"] for one in changes] == [1.5], "recorded by the computer that has the setting"

    (report,) = json.loads(ctl("doctor", "placement", "-n", "uav1", "--json", code=None).stdout)["platforms"]
    assert [unit["unit"] for unit in report["units"]] == ["main", "fc", "nav"]
    (pose,) = [
        one for one in report["inputs"] if one["path"] == "nav/pose" and "guidance" in one["applications"]
    ]
    assert (pose["unit"], pose["needed_ms"]) == ("nav", 600.0), "as the guidance states"
    assert pose["received_hz"] > 1
    assert pose["delay_worst_ms"] > 0
    assert pose["late"] is (pose["delay_p95_ms"] > 600.0)
    judged = {(one["unit"], one["application"]): one["verdict"] for one in report["modules"]}
    assert judged["fc", "guidance"] != "here", "it has an input of another computer"
    ctl("land", "uav1")
    ctl("lab", "down")
