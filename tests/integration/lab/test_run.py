"""The experiment from one command: the smallest swarm there is, real processes, a whole mission, a report."""

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import make_reader

from swarmctl.session import labs
from swarmlab.radio.namespace import check_rights
from swarmware.errors import Denied
from swarmware.model.config import share_dir

Done = subprocess.CompletedProcess[str]


def leaves(value: object, path: str = "") -> dict[str, object]:
    """Every value of a document by its path."""
    if not isinstance(value, dict):
        return {path: value}
    found: dict[str, object] = {}
    for key, inner in value.items():
        found |= leaves(inner, f"{path}.{key}".lstrip("."))
    return found


@pytest.fixture
def short_course(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The shipped experiment on a third of its course: one straight and one corner of it."""
    share = tmp_path / "share"
    shutil.copytree(share_dir(), share)
    manifest = share / "missions/formation/mission.toml"
    text, count = re.subn(
        r"^course = .*", "course = [[0.0, 0.0], [20.0, 0.0], [32.0, 8.0]]", manifest.read_text(), flags=re.M
    )
    assert count == 1
    manifest.write_text(text)
    monkeypatch.setenv("SWARM_SHARE", str(share))


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_three_nodes_fly_formation_and_report_has_everything(
    ctl: Callable[..., Done], labs_folder: Path, tmp_path: Path, short_course: None
) -> None:
    out = tmp_path / "report"
    try:
        check_rights()
    except Denied:
        net = "loopback"
    else:
        net = "netns"  # over the default radio
    done = ctl("lab", "run", "formation", "--nodes", "3", "--net", net, "--out", str(out), "--json")
    found = json.loads(done.stdout)
    assert json.loads((out / "run.json").read_text())["net"] == net
    assert found == json.loads((out / "report.json").read_text())
    figures = leaves(found)
    assert all(value is not None for value in figures.values()), figures
    assert (found["nodes"], found["completed"], found["collisions"]) == (3, True, 0)
    assert found["formation_error_m"]["mean"] < 1
    assert found["bytes_per_notification"] < 200
    assert found["traffic"]["global_kbps"] == pytest.approx(3 * found["traffic"]["egress_kbps"], rel=1e-3)
    assert found["notifications"] > 1000
    assert found["log_gaps"] == 0
    assert 0 < found["clock_error_us"]["p95"] < 5000, "offsets of seconds are found"
    assert [receipt["platform"] for receipt in found["receipts"]] == ["uav1", "ugv1"]
    assert all(receipt["command_ms"] > receipt["order_ms"] > 0 for receipt in found["receipts"])
    assert (out / "paths.png").read_bytes().startswith(b"\x89PNG")
    page = (out / "report.html").read_text()
    assert "swarmctl lab run formation --nodes 3" in page
    assert "barrier airborne: opened" in page
    assert all(f"{node}: " in page for node in ("gcs", "uav1", "ugv1"))
    links = set(re.findall(r'href="([^"#]+)"', page))
    assert {"report.json", "run.json"} < links and all((out / link).exists() for link in links)
    with (out / "run.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    topics = {channel.topic for channel in summary.channels.values()}
    assert topics >= {"/uav1/nav/pose", "/ugv1/nav/pose", "/foxglove/tf", "/foxglove/log"}
    on_map = {
        f"/foxglove/{name}/{path}"
        for name in ("uav1", "ugv1")
        for path in ("sensor/gnss", "nav/pose/location")
    }
    assert on_map <= {
        channel.topic
        for channel in summary.channels.values()
        if summary.schemas[channel.schema_id].name == "foxglove.LocationFix"
    }, "the map panel shows the flight"
    logs = sorted(out.glob("logs/*/*.mcap"))
    assert {path.parent.name for path in logs} == {"gcs", "ugv1", "uav1"}
    for path in logs:
        with path.open("rb") as file:
            assert list(make_reader(file).iter_messages()), f"{path}: readable by the mcap library"
    assert "mission completed" in done.stderr
    assert labs.labs() == []
    assert list(labs_folder.iterdir()) == []
