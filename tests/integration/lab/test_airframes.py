"""An operator commands a helicopter and an aircraft of a lab; each answer is an observation."""

import json
from typing import Any

from tests.integration.lab.conftest import Ctl


def test_helicopter_and_aircraft_take_off_and_land(ctl: Ctl, labs_folder: object) -> None:
    airframes = ("--airframe", "uav1=helicopter", "--airframe", "uav2=fixed_wing")
    ctl("lab", "up", "formation", "--nodes", "4", *airframes, "--detach")

    def command(*words: str) -> dict[str, Any]:
        found = json.loads(ctl(*words, "--json").stdout)["vehicles"]
        return {one["platform"]: (one["ok"], one["state"].split()[0]) for one in found}

    up = command("takeoff", "uav1", "uav2", "--altitude", "15", "--speed", "3", "--yes")
    assert up == {"uav1": (True, "holding"), "uav2": (True, "circling")}
    assert command("hold", "uav1", "uav2") == up
    assert command("goto", "uav1", "--by", "4,0") == {"uav1": (True, "holding")}
    ctl("kill", "uav2", "--confirm", "uav2")
    rows = {one["platform"]: one for one in json.loads(ctl("node", "ls", "--json").stdout)["nodes"]}
    assert (rows["uav1"]["armed"], rows["uav2"]["armed"]) == (True, False)
    assert command("land", "uav1") == {"uav1": (True, "landed")}
    ctl("lab", "down")
