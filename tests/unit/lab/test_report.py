"""The report: fixed keys, the paper's figures beside ours, one page that needs nothing else."""

import json

import msgspec
from tests.unit.lab.reports import GOOD

from swarmctl.terminal.table import fitted_table
from swarmlab.report import report
from swarmlab.report.report import MeanMax, Percentiles, Receipt

KEYS = json.loads(
    '{"schema_version":2,"nodes":16,"ready_s":0,"completed":true,"duration_s":0,"traffic":{"global_kbps":0,"egress_kbps":0,'
    '"ingress_kbps":0},"requests":0,"notifications":0,"bytes_per_notification":0,"command_to_receipt_ms":'
    '{"p50":0,"p99":0,"max":0},"order_to_receipt_ms":{"p50":0,"p99":0,"max":0},"receipts":[],"formation_error_m":{"mean":0,"max":0},"min_separation_m":0,"collisions":0,'
    '"frames_lost":0,"log_frames":0,"log_gaps":0,"clock_error_us":{"p95":0},"cpu_percent_of_core":{"mean":0,'
    '"max":0},"rss_mb":{"mean":0,"max":0},"host":{"processor":"","cores":2,"kernel":"","load_before":0,'
    '"nodes_percent":0,"others_percent":0},"pss_mb":{"mean":0,"max":0},"last_answer_ms":0}'
)
"""The promised document; programs of others read these keys."""


def test_documents_keys_are_those_promised_and_no_others() -> None:
    def shape(value: object) -> object:
        return {k: shape(v) for k, v in value.items()} if isinstance(value, dict) else None

    assert shape(report.rounded(GOOD)) == shape(KEYS)
    assert list(report.rounded(GOOD)) == list(KEYS)


def test_numbers_have_four_digits_and_counts_all() -> None:
    found = report.rounded(GOOD)
    assert (found["duration_s"], found["notifications"]) == (120.1, 123456)
    assert found["clock_error_us"] == {"p95": 22.26}
    assert msgspec.convert(found["receipts"], tuple[Receipt, ...])[1].command_ms == 3.412


def test_the_table_shows_the_papers_figures_beside_ours() -> None:
    text = fitted_table(report.columns(GOOD), report.cells(GOOD)).text
    for figure in ("56.07", "14.89", "1.31", "25", "81 297", "11.95 ms", "16.10 kB/s", "123 456", "1.5 ms"):
        assert figure in text


def test_unmeasured_figure_is_dash_not_zero() -> None:
    nothing = msgspec.structs.replace(
        GOOD, min_separation_m=None, command_to_receipt_ms=Percentiles(), formation_error_m=MeanMax()
    )
    rows = {row.what: row.ours for row in report.comparison(nothing)}
    assert rows["minimum separation"] == rows["command to receipt"] == rows["formation error"] == "-"


def test_collision_or_unfinished_mission_fails_experiment() -> None:
    assert report.shortfalls(GOOD) == []
    bad = msgspec.structs.replace(GOOD, completed=False, collisions=2)
    assert report.shortfalls(bad) == ["the mission was not completed", "2 collisions"]


def test_goals_that_were_missed_are_named_with_goal() -> None:
    assert report.misses(GOOD) == []
    slow = msgspec.structs.replace(
        GOOD, ready_s=15.0, command_to_receipt_ms=Percentiles(8.5, 12.5, 13), bytes_per_notification=None
    )
    slow = msgspec.structs.replace(slow, last_answer_ms=20.0)
    assert [text.split(":")[0] for text in report.misses(slow)] == [
        "ready",
        "command to receipt, p50",
        "command to receipt, p99",
        "command to last answer",
        "bytes per notification",
    ]


def test_run_of_another_size_is_not_compared() -> None:
    few = msgspec.structs.replace(GOOD, nodes=4)
    text = fitted_table(report.columns(few), report.cells(few)).text + report.markdown(few)
    assert not any(figure in text for figure in ("paper", "56.07", "14.89", "1.31", "81 297", "11.95"))
    assert "this run has 4" in report.comparison_note(few)
    assert report.comparison_note(GOOD) == ""
    assert report.markdown(GOOD).splitlines()[:2] == ["| | paper | here | |", "|---|---|---|---|"]
    assert report.markdown(few).splitlines()[:2] == ["| | here | |", "|---|---|---|"]
