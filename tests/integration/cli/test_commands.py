"""Output of every command against a running swarm, as JSON and as text."""

import time
from collections.abc import Callable, Iterable
from typing import Any

import pytest
import yaml
from tests.integration.cli.conftest import NODES, Ctl
from tests.patience import PATIENCE_S

from swarmctl.terminal.output import SCHEMA_VERSION

Check = Callable[[dict[str, Any]], object]

POSE_KEYS = {"x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "vx_m_s", "vy_m_s", "vz_m_s", "wz_rad_s"}


def platforms(found: Iterable[dict[str, Any]]) -> set[str]:
    return {one["platform"] for one in found}


@pytest.mark.parametrize(
    ("command", "check"),
    [
        (
            "node ls",
            lambda d: (
                platforms(d["nodes"]) == set(NODES)
                and all(n["answers"] and n["health"]["level"] in {"ok", "warn", "error"} for n in d["nodes"])
                and [n["route"]["hops"] for n in d["nodes"] if n["route"]] == [1, 1, 1]
            ),
        ),
        ("node ls -n uav1", lambda d: platforms(d["nodes"]) == {"uav1"}),
        ("node info", lambda d: d["platform"] == "gcs" and d["kind"] == "gcs"),
        ("node info uav1", lambda d: d["kind"] == "uav" and "navigator" in d["services"]),
        ("app ls", lambda d: platforms(u["table"] for u in d["units"]) == {"gcs"}),
        (
            "app ls --node uav1",
            lambda d: (
                {"broker", "tree", "sim"} <= {a["name"] for a in d["units"][0]["table"]["applications"]}
            ),
        ),
        (
            "app ls --all",
            lambda d: (
                {u["table"]["platform"]: u["hops"] for u in d["units"]} == {n: int(n != "gcs") for n in NODES}
                and all(
                    {"broker", "tree"} <= {a["name"] for a in u["table"]["applications"]} for u in d["units"]
                )
            ),
        ),
        ("tree ls /uav1", lambda d: len(d["entries"]) > 50 and d["more"] == 0),
        (
            "tree ls '/*/nav/pose'",
            lambda d: [e["path"] for e in d["entries"]] == [f"/{n}/nav/pose" for n in NODES if n != "gcs"],
        ),
        ("tree ls nav -n ugv1", lambda d: all(e["path"].startswith("/ugv1/nav") for e in d["entries"])),
        ("tree show /uav1/power", lambda d: d["entries"][-1]["type"] == "BatteryState"),
        ("tree get /uav1/nav/pose", lambda d: set(d["value"]) == POSE_KEYS and d["quality"] == "live"),
        # the ground station keeps poses: a young one answers, else the owner is asked
        ("tree get nav/pose -n uav1", lambda d: d["path"] == "/uav1/nav/pose" and d["source"] != "own"),
        ("tree get /uav1/nav/pose.x_m", lambda d: isinstance(d["value"], float)),
        ("tree get /uav1/sensor/range.ranges_m.0", lambda d: isinstance(d["value"], float | int)),
        ("tree get /gcs/mission/state", lambda d: d["source"] == "own" and d["value"]["kind"] == "gcs"),
        (
            "tree get '/*/power/battery.remaining_ratio'",
            lambda d: len(d["values"]) == 3 and all(0 < v["value"] <= 1 for v in d["values"]),
        ),
        ("wait /uav1/nav/pose 'z_m < 900'", lambda d: d["operands"][0]["value"] < 900),
        (
            "call /uav1/sys/tree/get path=nav/pose",
            lambda d: d["type"] == "TreeValue" and d["value"]["path"] == "/uav1/nav/pose",
        ),
        (
            "topo",
            lambda d: (
                d["nodes"] == list(NODES)
                and len(d["links"]) == 6
                and d["silent"] == []
                and all(link["both"] for link in d["links"])
            ),
        ),
        ("link ls", lambda d: platforms(d["neighbours"]) == {"uav1", "uav2", "ugv1"}),
        (
            "link ls -n uav1",
            lambda d: (
                platforms(d["neighbours"]) == {"gcs", "uav2", "ugv1"}
                and all(n["state"] == "up" and 0 <= n["loss_in_ratio"] <= 1 for n in d["neighbours"])
            ),
        ),
        (
            "traffic ls -n uav1",
            lambda d: (
                d["sent_bytes"] > 0
                and "nav/pose" in {c["channel"] for c in d["channels"]}
                and {link["transport"] for link in d["links"]} == {"udp", "tcp"}
            ),
        ),
        (
            "mission ls",
            lambda d: [(m["name"], m["sound"]) for m in d["missions"]] == [("formation", True)],
        ),
        ("mission check formation", lambda d: d["missions"][0]["sound"] and not d["missions"][0]["findings"]),
        ("mission queue -n uav1", lambda d: (d["platform"], d["runs"]) == ("uav1", [])),
        ("mission history -n uav1", lambda d: (d["platform"], d["failed_writes"]) == ("uav1", 0)),
        ("mission status -n uav1", lambda d: d["platform"] == "uav1" and "progress_ratio" in d["state"]),
        ("time ls", lambda d: platforms(d["functions"]) == {"uav1", "uav2", "ugv1"}),
        ("hal ls", lambda d: platforms(d["platforms"]) == set(NODES) and d["silent"] == []),
        (
            "hal ls -n uav1",
            lambda d: {driver["name"]: driver["actuator"] for driver in d["platforms"][0]["drivers"]}[
                "sim.chassis"
            ],
        ),
        ("time ls -n uav1", lambda d: all(abs(int(f["offset_ns"])) < 11e9 for f in d["functions"])),
        ("health ls", lambda d: platforms(d["platforms"]) == set(NODES) and d["silent"] == []),
        ("health ls -n uav1", lambda d: d["platforms"][0]["state"]["guard"] == "alive"),
        ("health info uav1", lambda d: {"app/sim", "age/nav/pose"} <= {c["check"] for c in d["checks"]}),
        (
            "health faults --cleared -n uav1",
            # a busy computer may be short of processor time, and late, while the nodes start
            lambda d: d["platform"] == "uav1" and not [f for f in d["faults"] if f["level"] == "error"],
        ),
        ("log stats -n uav1", lambda d: all(q["missing"] == 0 for q in d["queues"]) and d["queues"]),
        (
            "config get -n uav1",
            lambda d: (
                {"navigator/altitude_kp", "broker/tick_hz", "node/platform"}
                <= {s["key"] for s in d["settings"]}
                and {s["service"] for s in d["settings"] if s["running"]} >= {"node", "broker", "hal"}
                and not d["problems"]
            ),
        ),
        ("config get navigator/altitude_kp -n uav1", lambda d: len(d["settings"]) == 1),
        ("config get", lambda d: d["platform"] == "gcs" and not any(s["live"] for s in d["settings"])),
        ("config describe 'broker/*' -n uav1", lambda d: all(s["meaning"] for s in d["settings"])),
        (
            "config show broker",
            lambda d: (
                {s["service"] for s in d["settings"]} == {"broker"}
                and "broker/tick_hz" in {s["key"] for s in d["settings"]}
            ),
        ),
        ("config show node -n uav1", lambda d: "uav1" in {str(s["value"]) for s in d["settings"]}),
        (
            "traffic ls -n 'uav*'",
            lambda d: platforms(d["nodes"]) == {"uav1", "uav2"} and d["nodes"][1]["result"]["sent_bytes"] > 0,
        ),
        ("node info --all", lambda d: [n["result"]["platform"] for n in d["nodes"]] == list(NODES)),
        ("tree get nav/pose -n uav1,ugv1", lambda d: len(d["values"]) == 2),
        ("log stats -n 'uav{1,2}'", lambda d: d["queues"]),
        (
            "config show broker -n uav1,gcs",
            lambda d: all(n["result"]["settings"][0]["service"] == "broker" for n in d["nodes"]),
        ),
        ("doctor -n 'uav*'", lambda d: platforms(d["results"]) == {"", "uav1", "uav2"}),
        ("doctor", lambda d: {"services", "keys", "processor"} <= {r["check"] for r in d["results"]}),
        ("lab ls", lambda d: "labs" in d),
    ],
)
def test_command_gives_document_and_something_for_people(command: str, check: Check, ctl: Ctl) -> None:
    # doctor judges the machine, which this test does not
    codes = {0, 1, 2, 3} if command.startswith("doctor") else {0}
    end_s = time.monotonic() + PATIENCE_S
    while (found := ctl(f"{command} --json")).code not in codes or not check(found.document):
        # on a busy computer a beacon is late now and then, and a value older than it should be
        assert time.monotonic() < end_s, found.out[:2000] + found.err
    assert found.document["schema_version"] == SCHEMA_VERSION
    people = ctl(command)
    assert people.code in codes, people.err
    assert people.out.strip() or people.err.strip()
    assert not people.out.startswith("{") or command.startswith("tree get")
    for form in ("wide", "yaml", "jsonl"):
        shown = ctl(f"{command} -o {form}")
        assert shown.code in codes, f"{form}: {shown.err}"
        assert shown.out.strip() or shown.err.strip()
        if form == "yaml":
            (document,) = yaml.safe_load_all(shown.out)
            assert set(document) == set(found.document)
        elif form == "jsonl":
            assert all(one["schema_version"] == SCHEMA_VERSION for one in shown.lines)


@pytest.mark.parametrize(
    ("command", "code", "said"),
    [
        ("tree get /uav1/nav/bogus", 6, "no such resource; did you mean"),
        ("tree get /uav1/nav", 6, "a branch has no value"),
        ("tree get uav1/nav/pose", 6, "did you mean /uav1/nav/pose?"),
        ("tree get 'uav1/nav/*'", 6, "did you mean /uav1/nav/*?"),
        ("tree watch uav1/nav/pose", 6, "did you mean /uav1/nav/pose?"),
        ("tree ls uav1/nav", 6, "did you mean /uav1/nav?"),
        ("tree type uav1/nav/pose", 6, "did you mean /uav1/nav/pose?"),
        ("tree type Posee", 6, "no platform describes it"),
        ("tree get /uav1/nav/pose --field xm", 7, "no field 'xm'; expected one of x_m"),
        ("tree hz /uav1/nav/bogus", 6, "no such resource"),
        ("tree get /uav1", 6, "`swarmctl tree ls /uav1` shows its resources"),
        (
            "tree get /uav9/nav/pose",
            6,
            "node 'uav9': not known to gcs; expected one of gcs, uav1, uav2, ugv1",
        ),
        ("tree get /uav1/NAV", 7, "expected [a-z0-9_]+"),
        ("tree get /uav1/nav/pose.q", 7, "no field 'q'; expected one of x_m"),
        ("tree get '/*/bogus'", 6, "no resource with a value"),
        ("tree get '/uav1/{nav'", 7, "is not closed"),
        ("tree ls /uav9", 6, "node 'uav9': not known"),
        ("tree ls /uav1/bogus", 6, "no resource matches"),
        ("tree watch /uav1/bogus --count 1", 6, "no such resource"),
        ("tree watch /uav9/nav/pose --count 1", 6, "node 'uav9'"),
        ("file ls --node uav1", 6, "uav1: the service `files` does not run there; expected it in node.toml"),
        ("video ls --node uav1", 6, "uav1: the service `video` does not run there"),
        ("traffic set /uav1/nav/pose --buffer 1MB", 7, "with --protocol zmq a buffer keeps former ones"),
        ("tree set /uav1/config/navigator/altitude_kp abc", 7, "expected `float`, got `str`"),
        ("tree set /uav1/config/navigator/altitude_kp -1", 7, "-1 1/s; expected 0 to 100 1/s"),
        ("tree set /uav1/config/navigator/altitude_kp -- -1", 7, "expected 0 to 100"),
        ("tree set /uav1/config/navigator/altitude_kp 1 --if-version 99", 1, "expected 99"),
        ("tree set /uav1/config/navigator/bogus 1", 6, "no such resource"),
        ("tree set /uav1/nav/pose 1", 5, "access r"),
        ("tree set /uav9/nav/pose 1", 6, "node 'uav9'"),
        ("tree set /uav1/nav/pose", 2, "Missing argument 'VALUE'"),
        ("call /uav1/nav/pose", 7, "a board; expected a command"),
        ("call /uav1/cmd/bogus", 6, "no such resource"),
        ("call /uav9/cmd/abort reason=test", 6, "node 'uav9'"),
        ("call /uav1/sys/tree/get", 7, "field 'path' of TreeGet is missing"),
        ("call /uav1/sys/tree/get path=nav/bogus", 6, "no such resource"),
        ("call /uav1/sys/vehicle/arm armed=true", 2, "motors may turn: expected --yes"),
        ("pub mission/state 1", 5, "belongs to mission"),
        ("pub /uav1/test/height 1", 5, "of another node; expected a path of gcs"),
        ("pub cmd/abort 1", 7, "a command of mission#1; expected `swarmctl call`"),
        ("pub test/goal x_m=1", 7, "expected --type TYPE"),
        ("pub test/goal x_m=1 --type Goall", 6, "no platform describes it"),
        ("pub test/goal x_m=1 --type Goal", 7, "field 'seq' of Goal is missing"),
        ("wait /uav1/nav/pose 'z_m <'", 7, "at its end, column 6: expected a number"),
        (
            "wait /uav1/nav/pose 'z < 1'",
            7,
            "column 1 of condition 'z < 1': Pose has no field 'z'; did you mean",
        ),
        ("wait /uav1/mission/state 'state == \"off\"'", 7, "is never 'off': expected one of 'idle'"),
        ("wait -n uav1 cmd/abort 'x > 1'", 7, "is a command, which has no value"),
        ("wait /uav1/nav/pose 'z_m > 900' --timeout 1", 4, "not within 1 s; last: z_m"),
        ("node info uav9", 6, "node 'uav9'"),
        ("node info Uav1", 7, "platform name 'Uav1'"),
        ("node ls -n uav9", 6, "node 'uav9'"),
        ("app ls -n uav9", 6, "node 'uav9'"),
        ("link ls -n uav9", 6, "node 'uav9'"),
        ("traffic ls -n uav9", 6, "node 'uav9'"),
        ("time ls -n uav9", 6, "node 'uav9'"),
        ("hal ls -n uav9", 6, "node 'uav9'"),
        ("hal calibrate uav1 --confirm uav2", 2, "expected the same name"),
        ("health ls -n uav9", 6, "node 'uav9'"),
        ("log stats -n uav9", 6, "node 'uav9'"),
        ("config get navigator/altitude_k -n uav1", 6, "did you mean navigator/altitude_k"),
        ("config get 'bogus/*' -n uav1", 6, "no key of the configuration matches"),
        ("config get -n uav9", 6, "node 'uav9'"),
        ("config set navigator/altitude_kp -1 -n uav1", 7, "expected 0 to 100"),
        ("config show bogus", 6, "no key of the configuration matches 'bogus/*'"),
        ("config set broker/tick_hz 5 -n uav1", 5, "swarmctl app restart broker -n uav1"),
        ("config set navigator/altitude_kp -n uav1", 2, "either VALUE or --default"),
        ("traffic set 'nav/*' --rate fast", 7, "rate 'fast': expected 5hz"),
        ("traffic set 'nav/*' --rate 2hz --for ever", 7, "time 'ever'"),
        ("traffic set 'nav/[' --rate 2hz", 7, "unexpected '['"),
        ("traffic set 'nav/*'", 2, "expected --rate, --protocol"),
        ("mission check bogus", 6, "neither a file or folder nor a shipped mission"),
        ("mission check /etc/hostname", 7, "must not be flown"),
        ("mission start formation", 2, "expected --yes"),
        ("mission start bogus --yes", 6, "mission 'bogus'"),
        ("mission start formation --yes --set speed", 7, "expected NAME=VALUE"),
        ("mission start formation --yes --set bogus=1", 7, "parameter 'bogus': unknown"),
        ("mission start formation --yes --member uav9", 6, "node 'uav9': not known"),
        ("mission abort --yes", 6, "expected one"),
        ("mission answer", 6, "no block waits for an answer"),
        ("mission cancel 5 --yes", 6, "run 5: neither played nor kept"),
        ("mission prioritize 5 10", 6, "run 5: neither played nor kept"),
        ("mission prioritize 5 100", 2, "is not in the range 0<=x<=99"),
        ("log query --since ever", 7, "time 'ever'"),
        ("log export --out /nowhere/x.csv", 6, "file /nowhere/x.csv: no such file"),
        ("log query --dir /nowhere", 6, "no segments"),
        ("topo --png /nowhere/x.png", 6, "file /nowhere/x.png"),
        ("topo --dot --png x.png", 2, "not both"),
        ("--lab bogus node ls", 6, "lab 'bogus'"),
        ("node ls --config /nowhere", 7, "/nowhere/node.toml: no such file"),
        ("tree gett", 2, "No such command"),
    ],
)
def test_a_mistake_has_its_own_words_and_code(command: str, code: int, said: str, ctl: Ctl) -> None:
    done = ctl(command)
    assert (done.code, done.out if code not in {7} else "") == (code, ""), done.err
    assert said in done.err
    assert len(done.err.splitlines()) == 1 or code == 2, "one line says it"
