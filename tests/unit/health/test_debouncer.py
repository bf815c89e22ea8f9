"""Debounce, grace and limits with hysteresis."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import InvalidInput
from swarmware.health.criterion import Above, Below
from swarmware.health.debouncer import Debouncer


def believed(judge: Debouncer, results: str) -> str:
    """Confirmed states after each result, as letters: o for ok, w for warn."""
    names = {"o": "ok", "w": "warn", "e": "error"}
    out = []
    for at, letter in enumerate(results):
        judge.on_sample(names[letter], at)
        out.append(judge.confirmed[0])
    return "".join(out)


@pytest.mark.parametrize(
    ("confirm", "results", "states"),
    [
        ((1, 1), "owowo", "owowo"),
        ((2, 2), "owowwoow", "ooooww" + "oo"),
        ((3, 5), "wowow", "oooow"),
        ((3, 5), "wwwooo", "oowwwo"),
        ((2, 3), "wewe", "oowe"),
    ],
)
def test_n_of_the_last_m_results_must_agree(confirm: tuple[int, int], results: str, states: str) -> None:
    assert believed(Debouncer(confirm_n=confirm[0], confirm_m=confirm[1]), results) == states


def test_nothing_is_judged_during_the_grace() -> None:
    judge = Debouncer(grace_until_ns=10)
    assert not judge.on_sample("error", 9)
    assert judge.confirmed == "ok"
    assert judge.on_sample("error", 10)


@pytest.mark.parametrize("confirm", [(0, 1), (3, 2)])
def test_an_impossible_confirmation_is_refused(confirm: tuple[int, int]) -> None:
    with pytest.raises(InvalidInput, match="confirm"):
        Debouncer(confirm_n=confirm[0], confirm_m=confirm[1])


@given(st.integers(1, 4), st.lists(st.sampled_from(["ok", "warn", "error"])))
def test_a_believed_state_was_seen_often_enough(n: int, results: list[str]) -> None:
    judge = Debouncer(confirm_n=n, confirm_m=4)
    for at, result in enumerate(results):
        if judge.on_sample(result, at):
            assert results[max(0, at - 3) : at + 1].count(judge.confirmed) >= n


def test_a_limit_has_a_hysteresis() -> None:
    charge = Below(warn=0.3, error=0.15, hysteresis=0.02)
    values = [0.5, 0.29, 0.31, 0.33, 0.14, 0.16, 0.18, 0.31, 0.4]
    assert [charge(value) for value in values] == [
        "ok",
        "warn",
        "warn",
        "ok",
        "error",
        "error",
        "warn",
        "warn",
        "ok",
    ]


def test_above_is_below_turned_round() -> None:
    heat = Above(warn=80, error=95, hysteresis=5)
    assert [heat(value) for value in (70, 81, 76, 74, 96, 91, 89)] == [
        "ok",
        "warn",
        "warn",
        "ok",
        "error",
        "error",
        "warn",
    ]


def test_a_value_that_nobody_measured_is_an_error() -> None:
    assert Below(warn=1)(math.nan) == "error"
    assert Above(error=1)(math.nan) == "error"


def test_a_criterion_without_limits_is_refused() -> None:
    with pytest.raises(InvalidInput, match="limit"):
        Above()
