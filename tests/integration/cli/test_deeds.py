"""Effects of commands that change something, keep running, or write files."""

import csv
import json
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from tests.integration.cli.conftest import NODES, Ctl, Lab
from tests.patience import PATIENCE_S

from swarmware.model.clock import utc_ns

GAIN = "/uav2/config/navigator/altitude_kp"


def test_a_setting_is_changed_versioned_and_read_back(ctl: Ctl) -> None:
    before = ctl(f"tree get {GAIN} --json").document
    done = ctl(f"tree set {GAIN} 1.5 --if-version {before['version']} --json").document
    assert (done["path"], done["value"], done["version"]) == (GAIN, 1.5, before["version"] + 1)
    assert ctl(f"tree get {GAIN}").out == "1.5 1/s\n"
    assert ctl(f"tree set {GAIN} 2 --if-version {before['version']}").code == 1
    assert done["applied_by"] == ["navigator"], "it was followed to the module that flies with it"
    changed = ctl("config set navigator/altitude_kp 1.25 -n uav2").out
    assert changed == f"{GAIN} = 1.25 (version {before['version'] + 2}, in force in navigator)\n"
    assert "in force in mission)" in ctl("config set mission/link_loss_s 12 -n uav2").out
    assert ctl("config get navigator/altitude_kp -n uav2").out == "1.25\n"
    assert ctl(f"tree watch {GAIN} --count 1").out.endswith("  1.25 1/s\n")
    undone = ctl("config undo navigator/altitude_kp -n uav2").out
    assert undone == f"{GAIN} = 1.5 (version {before['version'] + 3}, in force in navigator; was 1.25)\n"
    assert ctl("config get navigator/altitude_kp -n uav2").out == "1.5\n"
    assert ctl(f"tree undo {GAIN} --json").document["value"] == 1.25
    refused = ctl(f"tree set {GAIN} 2 --version 99")
    assert refused.code == 1
    assert f"has version {before['version'] + 4} (1.25) now; expected 99" in refused.err
    changes = ctl(f"tree log {GAIN} --since 1h --count 2 --json").document["changes"]
    assert [(one["before"], one["after"], bool(one["refused"])) for one in changes] == [
        (1.25, None, True),
        (1.5, 1.25, False),
    ]
    assert all("gcs" in one["by"] for one in changes)


def test_what_is_not_mirrored_yet_is_watched(ctl: Ctl) -> None:
    lines = ctl("tree watch /uav2/sensor/gnss --count 3 --json").lines
    assert len(lines) == 3
    assert {line["path"] for line in lines} == {"/uav2/sensor/gnss"}
    assert len({line["stamp_ns"] for line in lines}) == 3
    assert set(lines[0]["value"]) >= {"lat_deg", "lon_deg"}


def test_a_pattern_watches_the_whole_swarm(ctl: Ctl) -> None:
    out = ctl("tree watch '/*/nav/pose.x_m' --count 12").out
    assert {line.split()[-3] for line in out.splitlines()} >= {"/uav1/nav/pose", "/ugv1/nav/pose"}


OWN_TYPE = """
import asyncio, msgspec
from swarmware import Module

class Gust(msgspec.Struct, array_like=True):
    speed_m_s: float

class Weather(msgspec.Struct):
    "Weather at one place."
    temp_degc: float
    "Of the air."
    gusts: list[Gust] = []

class Ask(msgspec.Struct):
    at_m: float

async def main() -> None:
    async with Module("weather") as m:
        board = m.writer("sensor/weather", Weather, rate_hz=100.0)
        m.serve("cmd/weather", Ask, lambda ask, _: Weather(ask.at_m), reply=Weather)
        async for _ in m.every(0.01):
            board.write(Weather(21.5, [Gust(3.0)]))

asyncio.run(main())
"""


def test_users_own_type_is_shown_on_another_platform(lab: Lab, ctl: Ctl, tmp_path: Path) -> None:
    source = tmp_path / "weather.py"
    source.write_text(OWN_TYPE)
    env = {**lab.env, "SWARM_CONFIG": f"{lab.node('uav1')['folder']}/etc"}
    with subprocess.Popen([sys.executable, source], env=env) as module:
        try:
            while ctl("tree get /uav1/sensor/weather --json").code:
                assert module.poll() is None
            lines = ctl("tree watch /uav1/sensor/weather --count 3 --json").lines
            assert lines[2]["value"] == {"temp_degc": 21.5, "gusts": [{"speed_m_s": 3.0}]}
            assert lines[2]["utc_ns"] is not None
            out = ctl("tree get /uav1/sensor/weather").out
            assert "  temp_degc          21.5 °C\n" in out
            assert "  gusts.0.speed_m_s  3 m/s\n" in out
            assert ctl("tree watch /uav1/sensor/weather --field temp_degc --count 1").out.endswith(
                " 21.5 °C\n"
            )
            shown = ctl("tree type Weather --json").document["types"]
            assert [one["name"] for one in shown] == ["Weather", "Gust"]
            assert shown[0]["fields"][0] | {"unit": "°C", "meaning": "Of the air."} == shown[0]["fields"][0]
            answer = ctl("call /uav1/cmd/weather at_m=12 --json").document
            assert (answer["type"], answer["value"]) == ("Weather", {"temp_degc": 12.0, "gusts": []})
            assert ctl("call cmd/weather 12 -n uav1").code == 7, "a type with a field of another name"
            with lab.started(
                "pub test/weather temp_degc=-3 'gusts=[{\"speed_m_s\": 2}]' --type Weather --rate 20"
            ) as pub:
                there = f"--config {lab.node('uav2')['folder']}/etc"
                while (got := ctl(f"tree get /gcs/test/weather --json {there}")).code:
                    assert pub.poll() is None
                assert got.document["value"] == {"temp_degc": -3.0, "gusts": [{"speed_m_s": 2.0}]}
                twice = ctl("pub test/weather temp_degc=1 --type Weather")
                assert (twice.code, "another application publishes it" in twice.err) == (5, True)
                pub.send_signal(signal.SIGINT)
                out, _ = pub.communicate(timeout=PATIENCE_S)
            assert re.fullmatch(r"/gcs/test/weather: \d+ values? .*of type Weather published\n", out)
            rate = ctl("tree hz /uav1/sensor/weather --window 1 --json").document["rates"][0]
            # counters of the owner: no link carries twenty a second, and a slow machine still writes them
            assert 20 < rate["written_hz"] < 150
            width = ctl("tree bw /uav1/sensor/weather --window 0.5 --json").document["bandwidths"][0]
            assert width["size_bytes"]["mean"] > 10
            delay = ctl("tree delay /uav1/sensor/weather --window 0.5 --json").document["delays"][0]
            assert delay["bound_s"] > 0
            entry = ctl("tree ls /uav1/sensor/weather --json").document["entries"][0]
            assert entry["measured_hz"] > 20, "of the last values, which may come in a burst"
        finally:
            module.terminate()


@pytest.fixture
def hello(lab: Lab) -> Iterator[None]:
    """The example module, on uav1."""
    source = Path(__file__).parents[3] / "share/swarm/examples/hello.py"
    env = {**lab.env, "SWARM_CONFIG": f"{lab.node('uav1')['folder']}/etc"}
    with subprocess.Popen([sys.executable, source], env=env) as module:
        try:
            yield
        finally:
            module.terminate()


def test_command_of_example_module_works_across_platforms(hello: None, ctl: Ctl) -> None:
    while (done := ctl("call /uav1/cmd/goto seq=1 kind=goto x_m=2.5 --json")).code == 6:
        pass
    assert done.document["receiver"] == "uav1:hello#1", done.err
    assert ctl('call cmd/goto \'{"seq": 2, "kind": "goto"}\' -n uav1').code == 0
    wrong = ctl("call /uav1/cmd/goto seq=2 kind=goto x_m=far")
    assert (wrong.code, "/uav1/cmd/goto.x_m: expected `float`, got `str`" in wrong.err) == (7, True)


def test_wait_at_another_node_begins_before_resource_exists(lab: Lab, ctl: Ctl) -> None:
    there = f"--config {lab.node('uav1')['folder']}/etc"
    condition = "'value > 2 and /uav1/vehicle/state.landed' --timeout 60"
    with lab.started(f"wait /gcs/test/depth {condition} --json {there}") as waiting:
        assert waiting.stderr is not None
        assert "does not exist yet" in json.loads(waiting.stderr.readline())["message"]
        assert ctl("pub test/depth 1.0 --hold 0.3").code == 0
        assert waiting.poll() is None
        while waiting.poll() is None:
            assert ctl("pub test/depth 2.5").code == 0
        out, err = waiting.communicate(timeout=PATIENCE_S)
    assert waiting.returncode == 0, err
    found = json.loads(out)["operands"]
    assert [(one["path"], one["field"]) for one in found] == [
        ("/gcs/test/depth", "value"),
        ("/uav1/vehicle/state", "landed"),
    ]


def test_event_is_waited_for_before_there_was_one(lab: Lab, ctl: Ctl) -> None:
    with lab.started("tree watch /gcs/tree/changes --count 1 --json") as watch:
        assert watch.stdout is not None
        while not select.select([watch.stdout], [], [], 0.05)[0]:
            assert watch.poll() is None
            ctl("tree set /gcs/mission/state 1")  # refused, which is an event as well
        out, _ = watch.communicate(timeout=PATIENCE_S)
    assert json.loads(out)["value"]["path"] == "/gcs/mission/state"


def test_rate_limit_starts_and_ends_by_itself(lab: Lab, ctl: Ctl) -> None:
    def pose() -> dict[str, Any]:
        channels = ctl("traffic ls -n uav1 --json").document["channels"]
        return next(c for c in channels if c["channel"] == "nav/pose")

    def rate() -> dict[str, Any]:
        (period,) = ctl("traffic top -n uav1 --period 0.5 --count 1 --json").lines
        return next((one for one in period["channels"] if one["channel"] == "nav/pose"), {"held_back_hz": 0})

    # somebody must want the poses, or none are sent
    with lab.started("tree watch /uav1/nav/pose --json") as reader:
        try:
            assert reader.stdout is not None
            json.loads(reader.stdout.readline())
            limits = ctl("traffic set '/uav1/nav/*' --rate 0.2hz --json").document["limits"]
            assert [(one["pattern"], one["settings"]["max_hz"]) for one in limits] == [("nav/*", 0.2)]
            began_s = time.monotonic()
            before = now = pose()
            # counters and events alone: at rest a vehicle sends two unchanged poses a second, else up to ten
            while now["held_back"] < before["held_back"] + 4:
                now = pose()
            due = (time.monotonic() - began_s) / 4.5  # a period may end half a beacon early
            assert now["max_hz"] == 0.2
            assert now["sent_frames"] <= before["sent_frames"] + 1 + due
            while not (seen := rate())["held_back_hz"]:
                pass
            assert seen["offered_hz"] >= seen["held_back_hz"]

            assert ctl("traffic clear '/uav1/nav/*' --json").document["limits"] == []
            limits = ctl("traffic set '/uav1/nav/*' --rate 0.2hz --for 1s --json").document["limits"]
            assert [0 < one["remaining_s"] <= 1 for one in limits] == [True]
            while (ended := pose())["max_hz"] is not None:
                pass
            while (now := pose())["sent_frames"] < ended["sent_frames"] + 4:
                assert now["held_back"] == ended["held_back"]
        finally:
            reader.send_signal(signal.SIGINT)
            reader.communicate(timeout=PATIENCE_S)
    assert reader.returncode == 130
    assert ctl("tree get /uav1/net/limits --json").document["value"]["limits"] == []
    assert ctl("traffic set 'nav/*' --rate 1hz -n uav1 --json").document["limits"]
    limits = ctl("traffic set 'nav/*' --rate auto:30hz -n uav1 --json").document["limits"]
    assert (limits[0]["settings"]["max_hz"], limits[0]["settings"]["adaptive"]) == (30.0, True)
    assert ctl("traffic set 'nav/*' --rate default -n uav1 --json").document["limits"] == []


def test_the_record_is_queried_followed_and_exported(ctl: Ctl, tmp_path: Path) -> None:
    ctl("log tail nav/pose -n uav1 --count 6")  # a lab that has just started has recorded fewer
    found = ctl("log query nav/pose -n uav1 --limit 5 --oldest --json").lines
    assert [line["path"] for line in found] == ["/uav1/nav/pose"] * 5
    newest = ctl("log query '/*/nav/pose' --limit 4 --since 1h --json").lines
    assert newest == sorted(newest, key=lambda line: int(line["utc_ns"]))
    began_utc_ns = utc_ns()
    tailed = ctl("log tail '/*/{nav,mission}/**' --count 40 --json").lines
    assert len(tailed) == 40
    assert tailed == sorted(tailed, key=lambda line: int(line["utc_ns"]))
    assert int(tailed[0]["utc_ns"]) >= began_utc_ns, "what was recorded before was not asked for"
    assert {line["path"].split("/")[1] for line in tailed} >= {"uav1", "uav2", "ugv1"}

    for form in ("jsonl", "csv", "mcap"):
        assert (
            ctl(
                f"log export nav/pose -n uav1 --limit 5 --oldest --format {form} --out {tmp_path}/x.{form}"
            ).code
            == 0
        )
    lines = [json.loads(line) for line in (tmp_path / "x.jsonl").read_text().splitlines()]
    with (tmp_path / "x.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    with (tmp_path / "x.mcap").open("rb") as file:
        read = make_reader(file).iter_messages(topics="/uav1/nav/pose")
        messages = [json.loads(m.data) for _, _, m in read]
    xs = [line["value"]["x_m"] for line in found]
    assert [line["value"]["x_m"] for line in lines] == xs
    assert [float(row["x_m"]) for row in rows] == xs
    assert [message["x_m"] for message in messages] == xs
    assert ctl("log query /uav1/bogus").err == "no entry matches\n"


def test_every_node_is_synchronised_with_its_sources(ctl: Ctl) -> None:
    expected = f"synced {len(NODES) - 1}/{len(NODES) - 1}"
    end_s = time.monotonic() + PATIENCE_S
    while (listed := ctl("node ls")).out.count(expected) != len(NODES):
        assert time.monotonic() < end_s, listed.out
    nodes = ctl("node ls --json").document["nodes"]
    assert [node["sync"]["followed"] for node in nodes] == [len(NODES) - 1] * len(NODES)


def test_unanswering_node_is_reported_as_silent(lab: Lab, ctl: Ctl) -> None:
    lab.signal("uav2", signal.SIGSTOP)
    try:
        # until its link has timed out a question waits; afterwards it is known at once
        first = ctl("link ls -n uav2 --timeout 1.5")
        assert first.code == 4, first.err
        assert "uav2" in first.err
        while "lost " not in (listed := ctl("node ls")).out:
            pass
        assert listed.code == 3
        lost = next(one for one in ctl("node ls --json").document["nodes"] if one["platform"] == "uav2")
        assert lost["sync"] is None
        assert lost["lost_s"] > 0
        assert (lost["armed"], lost["mode"]) == (False, "auto")
        last = ctl("tree get /uav2/nav/pose.z_m")
        assert last.code == 0
        assert "/uav2/nav/pose: lost; this is the last value" in last.err
        shown = ctl("node info uav2")
        assert shown.code == 4
        assert {line.split()[0] for line in shown.out.splitlines()[1:]} == {
            "platform", "lost", "position", "height", "battery", "mode", "mission"
        }  # fmt: skip
        assert ctl("tree get /uav2/nav/pose --fresh").code == 4
        for command in ("tree watch /uav2/nav/pose", f"tree set {GAIN} 1"):
            done = ctl(command)
            assert (done.code, done.out) == (4, ""), done.err
            assert "node 'uav2': known, but gcs has no route to it now" in done.err
        partial = ctl("topo --json")
        assert partial.code == 3
        assert partial.document["silent"] == ["uav2"]
        of_all = ctl("tree get '/*/nav/pose.x_m'")
        assert "/uav2/nav/pose " in of_all.out
        assert "/uav2/nav/pose: lost" in of_all.err
        assert ctl("health ls").code == 3
        while "without uav2" not in (start := ctl("mission start formation")).err:
            assert start.code == 2, "known to be away is one second, lost for a mission three"
        assert "uav2: takes no part: lost: no beacon for" in start.err
        assert "without uav2: they will move: expected --yes" in start.err
        landed = ctl("land --all --json")
        assert landed.code == 3
        assert {v["platform"]: v["ok"] for v in landed.document["vehicles"]} == {
            "uav1": True,
            "uav2": False,
            "ugv1": True,
        }
        assert ctl("land uav2").code == 4
    finally:
        lab.signal("uav2", signal.SIGCONT)
    while ctl("link ls -n uav2 --timeout 1").code:
        pass


def test_fault_of_lost_vehicle_is_ended_by_hand(lab: Lab, ctl: Ctl) -> None:
    clear = "health clear platform/uav2 -n gcs"
    lab.signal("uav2", signal.SIGSTOP)
    try:
        while "platform/uav2" not in ctl("health faults -n gcs").out:
            pass
        asked = ctl(clear)
        assert (asked.code, asked.out) == (2, "")
        assert "clear the faults that match platform/uav2: expected --yes" in asked.err
        done = ctl(f"{clear} --yes --json")
        assert done.code == 0, done.err
        (fault,) = done.document["faults"]
        assert (fault["check"], fault["state"]) == ("platform/uav2", "lost")
        assert "gcs: platform/uav2: lost cleared" in done.err
        assert "platform/uav2" not in ctl("health faults -n gcs").out
        assert "platform/uav2" in ctl("health faults -n gcs --cleared").out
        again = ctl(f"{clear} --yes")
        assert again.code == 6
        assert "gcs: no fault matches platform/uav2" in again.err
    finally:
        lab.signal("uav2", signal.SIGCONT)
    while ctl("link ls -n uav2 --timeout 1").code:
        pass


def test_a_mission_is_started_watched_and_aborted(lab: Lab, ctl: Ctl) -> None:
    ctl("node ls")
    with lab.started("mission start formation --yes --watch --json") as started:
        try:
            assert started.stdout is not None
            states: list[dict[str, Any]] = []
            for line in started.stdout:
                states.append(json.loads(line))
                if states[-1]["state"]["active"] == ["takeoff"]:
                    break
            assert ctl("mission status --json").document["state"]["mission"] == "formation"
            waiting = ctl("mission start formation --yes --json").document
            assert {one["accepted"] for one in waiting["orders"]} == {True}
            assert all(one["waits"] for one in waiting["orders"]), "one at a time"
            assert ctl(f"mission cancel {waiting['epoch']} --yes").code == 0
            reached = ctl("mission abort --then land --yes --json").document["reached"]
            assert sorted(reached) == ["gcs", "uav1", "uav2", "ugv1"]
            rest, err = started.communicate(timeout=PATIENCE_S)
        finally:
            started.kill()
    states += [json.loads(line) for line in rest.splitlines()]
    assert started.returncode == 1
    assert "unsuccessful at" in err
    last = {one["platform"]: one["state"]["state"] for one in states}
    assert last == dict.fromkeys(["gcs", "uav1", "uav2", "ugv1"], "aborted")
    assert {one["state"]["epoch"] for one in states} == {states[0]["state"]["epoch"]}


def test_listed_paths_of_swarm_are_completed(lab: Lab) -> None:
    assert lab.ctl("tree ls").code == 0
    words = "swarmctl tree get /uav1/nav/po"
    asked = {"_SWARMCTL_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": "3"}
    found = lab._replace(env={**lab.env, **asked}).ctl("")
    assert found.out == "plain,/uav1/nav/pose\n"


@pytest.mark.parametrize("command", ["node ls", "tree ls"])
def test_quiet_prints_results_alone_on_stdout(command: str, ctl: Ctl) -> None:
    done = ctl(f"{command} -q")
    assert (done.code, done.err) == (0, "")


def test_service_is_restarted_by_guard_and_runs_again(ctl: Ctl) -> None:
    asked = ctl("app restart logger -n uav1")
    assert (asked.code, asked.out) == (2, "")
    before = ctl("app restart logger -n uav1 --yes --json").document["services"][0]["restarts"]
    done = ctl("app restart logger -n uav1 --yes --json").document["services"]
    assert [(one["name"], one["state"], one["restarts"]) for one in done] == [
        ("logger", "running", before + 1)
    ]
    assert ctl("app restart gps -n uav1 --yes").code == 6


def test_changed_file_holds_unless_live_setting_overrides_it(ctl: Ctl, lab: Lab) -> None:
    file = Path(lab.node("uav1")["folder"]) / "etc/services/navigator.toml"
    before = file.read_text() if file.exists() else ""
    key = "navigator/altitude_kd"

    def shown() -> tuple[float, str, float, bool]:
        (found,) = ctl(f"config get {key} -n uav1 --json").document["settings"]
        return found["value"], found["origin"], found["file_value"], found["pending"]

    try:
        file.write_text(f"{before}\n[altitude]\nkd = 0.3\n")
        assert shown() == (0.1, "default", 0.3, True)
        assert ctl("app restart navigator -n uav1 --yes").code == 0
        assert shown() == (0.3, "file", 0.3, False)
        assert ctl("tree get /uav1/config/navigator/altitude_kd").out == "0.3\n"
        assert ctl(f"config set {key} 0.5 -n uav1").code == 0
        assert ctl("app restart navigator tree -n uav1 --yes").code == 0
        assert shown() == (0.5, "live", 0.3, False)
        away = ctl("config diff -n uav1 --json").document["differences"]
        assert {"key": key, "here": 0.5, "there": 0.3} in away
        assert ctl(f"config set {key} --default -n uav1").code == 0
        assert shown() == (0.3, "file", 0.3, False)
        last, first, *_ = ctl(f"config history {key} -n uav1 --json").document["changes"]
        assert (first["before"], first["after"], first["before_origin"]) == (0.3, 0.5, "file")
        assert (last["before"], last["after"], last["after_origin"]) == (0.5, 0.3, "file")
        assert "gcs" in last["by"]
    finally:
        file.write_text(before)


def test_stopped_service_stays_stopped_without_fault_until_started(ctl: Ctl) -> None:
    assert ctl("app stop logger -n uav1").code == 2, "it asks first"
    refused = ctl("app stop broker -n uav1 --yes")
    assert (refused.code, "cannot be stopped" in refused.err) == (5, True), refused.err
    stopped = ctl("app stop logger -n 'uav{1,2}' --yes --json")
    assert stopped.code == 0, stopped.err
    try:
        services = [node["result"]["services"][0] for node in stopped.document["nodes"]]
        assert [(one["state"], one["stopped_by"].endswith("gcs")) for one in services] == [
            ("stopped", True)
        ] * 2
        shown = ctl("app ls -n uav1 --json").document
        assert [(one["service"], one["platform"]) for one in shown["stopped"]] == [("logger", "uav1")]
        running = {app["name"] for unit in shown["units"] for app in unit["table"]["applications"]}
        assert "logger" not in running
        faults = ctl("health faults -n uav1 --json").document["faults"]
        assert [fault for fault in faults if "log" in fault["check"]] == []
        checks = {"age/nav/pose": ""}
        while (
            checks["age/nav/pose"] != "ok"
        ):  # the other resources are still checked; a busy computer is late
            found = ctl("health info uav1 --json").document["checks"]
            checks = {one["check"]: one["state"] for one in found}
    finally:
        started = ctl("app start logger -n 'uav{1,2}'")
    assert started.code == 0, started.err
    assert ctl("app ls -n uav1 --json").document["stopped"] == []


def test_drained_vehicle_takes_no_role_until_undrained(ctl: Ctl) -> None:
    done = ctl("node drain uav1 --json")
    assert (done.code, done.document["drained_by"].endswith("gcs")) == (0, True), done.err
    try:
        # the state of the vehicle reaches the ground station with its next beacon
        while "uav1: takes no part: drained by" not in ctl("mission start formation").err:
            assert ctl("node ls").code == 0
        named = ctl("mission start formation --member uav1 --member gcs --yes")
        assert (named.code, "'uav1': cannot take part: drained by" in named.err) == (7, True), named.err
        assert ctl("app restart mission -n uav1 --yes").code == 0
        assert ctl("mission status -n uav1 --json").document["state"]["drained_by"]
        row = next(line for line in ctl("node ls").out.splitlines() if line.startswith("uav1"))
        assert "drained by" in row
    finally:
        ended = ctl("node undrain uav1,uav2 --json")
    assert [node["result"]["drained_by"] for node in ended.document["nodes"]] == ["", ""]
    while "drained" in ctl("mission start formation").err:
        assert ctl("node ls").code == 0


def test_live_settings_move_between_vehicles_by_file(ctl: Ctl, tmp_path: Path) -> None:
    assert ctl("config set navigator/altitude_ki 0.25 -n uav1").code == 0
    assert ctl(f"config dump {tmp_path}/gains.toml -n uav1").code == 0
    found = ctl("config diff uav1 -n uav2 --json").document["differences"]
    assert {one["key"]: one["there"] for one in found}["navigator/altitude_ki"] == 0.25
    changed = ctl(f"config load {tmp_path}/gains.toml -n uav2 --yes --json").document["changed"]
    assert "navigator/altitude_ki" in {one["key"] for one in changed}
    assert ctl("config diff uav1 -n uav2 --json").document["differences"] == []
    (tmp_path / "gains.toml").write_text('"navigator/altitude_ki" = -1.0')
    assert ctl(f"config load {tmp_path}/gains.toml -n uav2").code == 7
    shown = ctl("config show navigator -n uav2")
    assert "live (file: 0.15)" in shown.out
    assert ctl("config diff ugv1 -n gcs").code == 6
