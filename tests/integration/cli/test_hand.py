"""The operator's hand on single vehicles, answered with what was seen of them."""

import json
import os
import pty
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.integration.cli.conftest import Ctl, Done, Lab
from tests.patience import PATIENCE_S

UP: dict[str, dict[str, Any]] = {
    "s": {"type": "Start", "next": "a"},
    "a": {"type": "Arm", "next": "t"},
    "t": {"type": "Takeoff", "altitude_m": 3, "speed_m_s": 2, "next": "w"},
    "w": {"type": "Wait", "s": 120, "next": "l"},
    "l": {"type": "Land", "next": "d"},
    "d": {"type": "Disarm", "next": "e"},
    "e": {"type": "End"},
}


MANIFEST = """name = "pair"
[[roles]]
name = "first"
file = "first.json"
kinds = ["uav"]
take = 1
[[roles]]
name = "second"
file = "second.json"
kinds = ["uav"]
take = 1
[[roles]]
name = "control"
file = "control.json"
kinds = ["gcs"]
"""


def meet(name: str, after: str) -> dict[str, Any]:
    return {
        "type": "Barrier",
        "id": name,
        "timeout_s": 90,
        "next": after,
        "nextTimeout": "late",
        "on": {"broken": "l"},
    }


def pair(folder: Path) -> Path:
    """Two vehicles meet in the air; the second waits at `down`, to which the first comes a minute later."""
    late = {"late": {"type": "End", "result": "failed"}}
    flight = UP | {"t": UP["t"] | {"next": "up"}, "w": {"type": "Wait", "s": 4, "next": "mid"}}
    flight |= {"up": meet("up", "w"), "down": meet("down", "l"), **late}
    minute = {"type": "Wait", "s": 60, "next": "down"}
    control: dict[str, Any] = {
        "s": {"type": "Start", "next": "up"},
        "up": meet("up", "mid"),
        "l": {"type": "End"},
    }
    control |= {"mid": meet("mid", "down"), "down": meet("down", "l"), **late}
    missions = {
        "first": flight | {"mid": meet("mid", "minute"), "minute": minute},
        "second": flight | {"mid": meet("mid", "down")},
        "control": control,
    }
    folder = folder / "pair"
    folder.mkdir()
    (folder / "mission.toml").write_text(MANIFEST)
    for name, mission in missions.items():
        (folder / f"{name}.json").write_text(json.dumps({"mission": mission}))
    return folder


def node(ctl: Ctl, name: str) -> dict[str, Any]:
    found: dict[str, Any] = next(n for n in ctl("node ls --json").document["nodes"] if n["platform"] == name)
    return found


def test_arming_asks_shows_and_is_audited(ctl: Ctl) -> None:
    asked = ctl("arm uav1")
    assert asked.code == 2
    assert "arm uav1: motors may turn: expected --yes" in asked.err
    assert node(ctl, "uav1")["armed"] is False

    done = ctl("arm 'ua*1' --yes")
    assert done.code == 0, done.err
    assert done.out.startswith("uav1 landed")
    assert " armed after " in done.out
    while not (shown := node(ctl, "uav1"))["armed"]:
        pass
    assert (shown["mode"], shown["battery_ratio"] > 0.5, abs(shown["height_m"]) < 1) == ("auto", True, True)
    assert node(ctl, "gcs")["armed"] is None
    assert {"MODE", "ARMED", "BATTERY"} < set(ctl("node ls").out.splitlines()[0].split())

    hazard = ctl("""tree set /uav1/sys/vehicle/arm.armed true""")
    assert hazard.code == 2
    assert "uav1: set sys/vehicle/arm.armed: motors may turn: expected --yes" in hazard.err
    assert ctl("""tree set /uav1/sys/vehicle/kill '{"platform": "uav1"}'""").code == 2
    assert ctl("disarm uav1 uav2 --json").document["vehicles"][0]["armed"] is False
    assert ctl("disarm uav1").out.startswith("uav1 landed")
    orders: list[dict[str, Any]] = []
    while [order["what"] for order in orders] != ["arm", "disarm", "disarm"]:
        orders = [line["value"] for line in ctl("log query /uav1/vehicle/orders --json").lines[-3:]]
    assert all(order["by"].endswith("gcs") and order["refused"] == "" for order in orders)


ARM_MISSION = """{"mission": {
    "start": {"type": "Start", "next": "arm"},
    "arm": {"type": "Arm", "next": "end"},
    "end": {"type": "End"}
}}"""


def test_vehicle_of_unknown_readiness_arms_by_recorded_force(ctl: Ctl, tmp_path: Path) -> None:
    assert ctl("health ready uav2").out.split()[4:6] == ["uav2", "yes"]
    assert ctl("app stop health --node uav2 --yes").code == 0
    refused = ctl("arm uav2 --yes")
    assert refused.code == 5
    assert "not ready: health: no health/ready" in refused.err
    failed = ctl("takeoff uav2 --timeout 20")
    assert failed.code == 1
    assert "not ready: health: no health/ready" in failed.err
    file = tmp_path / "motors.json"
    file.write_text(ARM_MISSION)
    started = ctl(f"mission start {file} --member uav2 --yes")
    assert started.code == 0, started.err
    while ctl("mission status --node uav2 --json").document["state"]["state"] != "failed":
        pass
    assert "not ready: health" in ctl("mission status --node uav2 --json").document["state"]["text"]
    assert node(ctl, "uav2")["armed"] is False

    unknown = ctl("health ready uav2 --json")
    assert unknown.code == 1
    (row,) = unknown.document["vehicles"]
    assert (row["ready"], row["not_ready"][0]["item"]) == (None, "health")

    forced = ctl("arm uav2 --yes --force --reason 'bench test'")
    assert forced.code == 0, forced.err
    assert ctl("disarm uav2").code == 0
    order: dict[str, Any] = {}
    while order.get("reason") != "bench test":
        found = ctl("log query /uav2/vehicle/orders --node uav2 --json").lines
        order = next((line["value"] for line in found if line["value"]["overridden"]), {})
    assert (order["what"], order["refused"]) == ("arm", "")
    assert order["by"].endswith("gcs")
    assert "no health/ready" in order["overridden"]

    assert ctl("app start health --node uav2").code == 0
    while ctl("health ready uav2").code:
        pass
    assert ctl("arm uav2 --yes").code == 0
    assert ctl("disarm uav2").code == 0


class Hand:
    """`swarmctl drive` at a terminal of its own."""

    def __init__(self, lab: Lab, command: str) -> None:
        self._own, other = pty.openpty()
        with open(other, "rb", buffering=0) as terminal:  # noqa: PTH123 - a descriptor
            self._process = subprocess.Popen(
                lab.words(command),
                stdin=terminal,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env=lab.env,
            )
        assert self._process.stdout is not None
        self._out = self._process.stdout

    def press(self, key: str, seen: str) -> None:
        """Holds a key until a line on the screen has this text."""
        line = b""
        while seen.encode() not in line:
            os.write(self._own, key.encode())
            line = self._out.readline()
            assert line, self._process.communicate()[1].decode()

    def end(self, key: str = "x") -> tuple[int, str]:
        """Presses the key that releases the vehicle; exit code and messages."""
        os.write(self._own, key.encode())
        out, err = self._process.communicate(timeout=PATIENCE_S)
        os.close(self._own)
        return self._process.returncode, out.decode().splitlines()[-1] + err.decode()


def test_driven_vehicle_lands_after_losing_its_operator(lab: Lab, ctl: Ctl) -> None:
    up = ctl("takeoff uav1 --altitude 3 --json")
    assert up.code == 0, up.err
    (one,) = up.document["vehicles"]
    assert (one["ok"], one["armed"], one["height_m"] > 2.4, one["state"][:7]) == (True, True, True, "holding")
    assert (ctl("takeoff ugv1").code, ctl("drive uav1").code) == (7, 2)

    hand = Hand(lab, "drive uav1")
    hand.press("w", "flying")
    while node(ctl, "uav1")["mode"] != "manual":
        pass
    with lab.killed("gcs"):
        mode = f"--config {lab.node('uav1')['folder']}/etc tree get /uav1/control/state.mode"
        while ctl(mode).out != "hold\n":
            pass
    while ctl("node ls").code:
        pass
    hand.press("j", "manual · answered")
    code, said = hand.end("\x03")
    assert (code, "mode auto" in said) == (0, True), said

    moved = ctl("goto uav1 --by 2,0 --json")
    assert (moved.code, moved.document["vehicles"][0]["ok"]) == (0, True), moved.err
    down = ctl("land uav1")
    assert down.code == 0, down.err
    assert down.out.startswith("uav1 landed ")


def test_absent_or_groundless_vehicle_is_refused(ctl: Ctl) -> None:
    for command in ("hold", "land", "return", "disarm", "arm --yes"):
        assert ctl(command).code == 2, command
        assert ctl(f"{command} uav1 --all").code == 2, command
        missing = ctl(f"{command} 'uav7*'")
        assert (missing.code, "no node matches" in missing.err) == (6, True), missing.err
        station = ctl(f"{command} gcs")
        assert (station.code, "a ground station; expected a vehicle" in station.err) == (7, True), station.err
    assert ctl("kill nobody --confirm nobody").code == 6


def test_flying_vehicles_are_held_returned_and_killed(lab: Lab, ctl: Ctl, tmp_path: Path) -> None:
    unsure = UP | {"l": {"type": "Land", "next": "d", "nextError": "e"}}
    (tmp_path / "up.json").write_text(json.dumps({"mission": unsure}))
    assert ctl("mission abort --yes").code == 6, "none runs yet"
    start = f"mission start {tmp_path}/up.json --member uav1 --member uav2"
    asked = ctl(start)
    assert asked.code == 2
    assert "start up with uav1, uav2: they will move" in asked.err
    # what `check` warns of is said once, and stands in the document
    (warning,) = [line for line in asked.err.splitlines() if line.startswith("warning: ")]
    assert "the mission can end at 'e' in the air: expected a Land before it" in warning
    started = ctl(f"{start} --yes --json")
    assert started.code == 0
    assert [json.loads(line)["warning"] for line in started.err.splitlines()] == [
        warning.removeprefix("warning: ")
    ]
    assert started.document["warnings"] == [warning.removeprefix("warning: ")]
    while node(ctl, "uav1")["height_m"] < 2.5 or node(ctl, "uav2")["height_m"] < 2.5:
        pass
    assert ctl("mission watch uav7").code == 6

    # the ground station is no member, and the mission is found all the same
    with lab.started("mission watch --json") as watch:
        assert watch.stdout is not None
        seen = {json.loads(watch.stdout.readline())["platform"] for _ in range(2)}
        assert seen == {"uav1", "uav2"}
        watch.kill()

    refused = ctl("disarm uav1")
    assert (refused.code, "disarming in the air" in refused.err) == (5, True)
    held = ctl("hold uav1")
    assert held.code == 0, held.err
    assert held.out.startswith("uav1 holding ")
    assert " armed after " in held.out
    states = ctl("mission status --json").document["others"]
    assert (states["uav1"]["state"], states["uav2"]["state"]) == ("aborted", "running")

    assert ctl("mission abort -n uav2 --then return").code == 2
    back = ctl("mission abort -n uav2 --then return --yes --json")
    assert back.code == 0, back.err
    (one,) = back.document["vehicles"]
    assert (one["platform"], one["ok"], one["armed"], one["mission"]) == ("uav2", True, False, "aborted")
    assert one["from_home_m"] < 3
    assert ctl("tree get /uav1/mission/state.state").out == "aborted\n"

    assert ctl("kill uav1").code == 2
    assert ctl("kill uav1 --confirm uav2").code == 2
    assert node(ctl, "uav1")["armed"] is True
    killed = ctl("kill uav1 --confirm uav1 --reason test --json")
    assert killed.code == 0, killed.err
    assert killed.document["vehicles"][0]["armed"] is False
    down = ctl("land --all")
    assert down.code == 0, down.err
    assert [line.split()[1] for line in sorted(down.out.splitlines())] == ["landed", "landed", "stopped"]
    while "kill" not in (log := ctl("log query /uav1/vehicle/orders --json").out):
        pass
    assert '"reason":"test"' in log


def test_mission_completes_without_ground_station_and_aborted_vehicle(
    lab: Lab, ctl: Ctl, tmp_path: Path
) -> None:
    former = {
        n: ctl(f"tree get /{n}/mission/state --json").document["value"]["epoch"] for n in ("uav1", "uav2")
    }
    start = f"mission start {pair(tmp_path)} --member uav1 --member uav2 --member gcs --yes"
    while (started := ctl(start)).code:  # a flight before this one may still be landing
        assert "busy" in started.err, started.err

    def until(platform: str, block: str, at: Callable[[str], Done]) -> None:
        state: dict[str, Any] = {"active": []}
        while block not in state["active"]:
            state = at(f"tree get /{platform}/mission/state --json").document["value"]
            # just after the start, what is known may still be of the flight before
            assert state["epoch"] == former[platform] or state["state"] in {"ready", "running"}, state

    def there(command: str) -> Done:
        return ctl(f"--config {lab.node('uav1')['folder']}/etc {command}")

    until("uav1", "w", ctl)
    with lab.killed("gcs"):
        # the barrier that the ground station never comes to opens without it, and nobody lands
        until("uav1", "minute", there)
        until("uav2", "down", there)
    while ctl("node ls").code:
        pass
    held = ctl("mission abort -n uav1 --then hold --yes")
    assert held.code == 0, held.err
    # the barrier breaks for the other one, whose mission then lands and comes to its End
    while (state := ctl("tree get /uav2/mission/state --json").document["value"])["state"] != "done":
        assert state["state"] in {"running", "ending"}, state
    assert ctl("tree get /uav1/mission/state.state").out == "aborted\n"
    assert ctl("land --all").code == 0
