"""Dumps, live views, rules and graphs of the tree, on the lab of four nodes."""

from pathlib import Path

from tests.integration.cli.conftest import Ctl

GAIN = "/uav2/config/navigator/altitude_kp"


def test_dump_is_compared_with_now_and_loaded_back(ctl: Ctl, tmp_path: Path) -> None:
    file = tmp_path / "uav2.toml"
    assert ctl(f"tree dump /uav2/config --file {file}").code == 0
    before = ctl(f"tree get {GAIN} --json").document["value"]
    assert ctl(f"tree set {GAIN} 1.75").code == 0
    [found] = ctl(f"tree diff {file} --json").document["differences"]
    assert (found["path"], found["here"], found["there"]) == (GAIN, before, 1.75)
    assert ctl(f"tree load {file}").code == 2, "it asks before it sets"
    [loaded] = ctl(f"tree load {file} --yes --json").document["changed"]
    assert (loaded["path"], loaded["after"]) == (GAIN, before)
    assert ctl(f"tree diff {file} --json").document["differences"] == []
    findings = ctl("tree lint --templates --json").document["findings"]
    assert all(one["level"] == "warning" for one in findings)
    positions = ctl("topo --watch --count 1 --json").lines[0]["positions"]
    assert {"uav1", "uav2", "ugv1"} <= set(positions)


def test_rule_holds_at_its_platform_until_reset(ctl: Ctl) -> None:
    rule = {"pattern": "power/*", "deadband": 0.5, "min_interval_s": 2.0, "max_interval_s": 0.0}
    set_there = ctl("tree rule '/uav2/power/*' --deadband 0.5 --min-interval 2s --json").document
    assert set_there == {"schema_version": 2, "platform": "uav2", "rules": [rule]}
    assert ctl("tree ls /uav2/power/battery --json").document["entries"][0]["rule"] == rule
    assert "rule ±0.5 ≥2s" in ctl("tree show /uav2/power").out
    # the ground station keeps the battery of each vehicle
    [channel] = ctl("traffic channels /uav2/power/battery --json").document["states"]["channels"]
    rate = {"source": "tree rule", "max_hz": 0.5, "platform": "uav2", "pattern": "power/*", "link": ""}
    assert (channel["link"], channel["rate"]) == ("*", rate)
    assert ctl("tree rule '/uav2/power/*' --reset --json").document["rules"] == []
    assert ctl("tree rule '/uav2/power/*' --reset").code == 6


def test_the_graph_is_drawn_in_every_form(ctl: Ctl, tmp_path: Path) -> None:
    dot = ctl("topo --dot").out
    assert dot.startswith("graph swarm {")
    assert '"gcs" -- "uav1"' in dot
    assert ctl(f"topo --png {tmp_path}/graph.png").code == 0
    assert (tmp_path / "graph.png").read_bytes().startswith(b"\x89PNG")
