"""The pause before the next attempt grows with the failures in a row, up to the last of its table."""

import pytest

from swarmware.runtime.backoff import pause_after


@pytest.mark.parametrize(("failures", "pause_s"), [(1, 0.0), (2, 0.5), (3, 2.0), (4, 2.0), (1_000_000, 2.0)])
def test_the_pause_grows_up_to_the_last_one(failures: int, pause_s: float) -> None:
    assert pause_after(failures, (0.0, 0.5, 2.0)) == pause_s


def test_a_table_of_one_pause_is_constant() -> None:
    assert [pause_after(n, (7,)) for n in range(1, 5)] == [7] * 4
