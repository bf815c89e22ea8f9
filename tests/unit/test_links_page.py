"""The page of the links has the kept measurements, and each of its commands exists."""

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "bench"))
import links
from links import BENCHES, KEPT, PAGE, ROOT, message_rows, pose_rows, written
from rows import Bare, Row


def test_the_page_has_the_figures_that_were_kept() -> None:
    page = PAGE.read_text("utf-8")
    assert written(page, json.loads(KEPT.read_text("utf-8"))) == page, "run `make bench-links`"


def test_each_command_exists_and_figure_names_machine() -> None:
    kept = json.loads(KEPT.read_text("utf-8"))
    assert set(kept) <= {bench.name for bench in BENCHES}
    for bench in BENCHES:
        assert (ROOT / "tests/bench" / bench.script).exists()
    for found in kept.values():
        assert found["machine"]
        assert found["load"]
        assert all(Row(**row).figure for row in found["rows"])


def test_a_benchmark_that_was_not_run_says_so() -> None:
    page = written(PAGE.read_text("utf-8"), {})
    for bench in BENCHES:
        assert f"| {bench.cases} | not measured | | | `python tests/bench/{bench.script}` |" in page


def test_ratios_and_ages_are_judged_by_goals() -> None:
    figures = {
        size: {"app_broker_broker_app_us": {"p50": ours}, "zeromq_curve_tcp_us": {"p50": 100}, "refusal": ""}
        for size, ours in (("200", 250), ("2000", 251))
    }
    small, large = message_rows([json.dumps(figures)])
    assert (small.is_met, large.is_met) == (True, False)
    assert "2.50 times" in small.figure
    swarms = {
        "16 nodes": {"bytes_s_of_a_node": 4600.0, "2_hops_p95_s": 0.29},
        "100 nodes": {"bytes_s_of_a_node": 7000.0, "2_hops_p95_s": 0.33},
        "16 nodes in one cell": {"bytes_s_of_all": 27_001.0},
    }
    assert [row.is_met for row in pose_rows([json.dumps(swarms)])] == [True, False, False]


@pytest.mark.parametrize(("figure", "refused"), [(80.0, 0), (120.0, 0), (120.1, 1), (480.0, 1)])
def test_bare_figure_above_start_refuses_ratio(figure: float, refused: int) -> None:
    at_start = iter((130.0, 100.0, 110.0))
    bare = Bare.measured(lambda: next(at_start))
    assert bool(bare.refusal(figure)) == bool(refused)
    assert bare.refused == refused


def test_refused_rows_are_printed_and_former_ones_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kept, page = tmp_path / "links.json", tmp_path / "links.md"
    kept.write_text(KEPT.read_text("utf-8"))
    page.write_text(PAGE.read_text("utf-8"))
    monkeypatch.setattr(links, "KEPT", kept)
    monkeypatch.setattr(links, "PAGE", page)
    refused = Row("message", "2.18 times", "≤ 2.5 times", True, Bare([100.0]).refusal(479.0))
    monkeypatch.setattr(links, "measured", lambda _: ({"rows": [refused._asdict()]}, [refused]))
    monkeypatch.setattr(sys, "argv", ["links.py", "--only", "message", "--write"])
    assert links.main() == 3
    assert "REFUSED: taken under load, bare 479 where 100 was reached" in capsys.readouterr().out
    assert kept.read_text() == KEPT.read_text("utf-8")
    assert page.read_text() == PAGE.read_text("utf-8")
