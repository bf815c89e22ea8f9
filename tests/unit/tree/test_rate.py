"""The rate of a resource, from two of its values that are still in shared memory."""

import pytest

from swarmd.tree.core.values.quality import measured_hz


@pytest.mark.parametrize(
    ("values", "span_s", "age_s", "expected"),
    [
        (3, 0.3, 0.01, 10.0),
        (3, 0.3, None, 10.0),
        (3, 0.3, 0.15, 10.0),
        (3, 0.3, 2.7, 1.0),
        (0, 0.3, 0.0, None),
        (-1, 0.3, 0.0, None),
        (3, 0.0, 0.0, None),
        (3, -1.0, 0.0, None),
    ],
)
def test_the_rate_falls_when_its_owner_is_silent(
    values: int, span_s: float, age_s: float | None, expected: float | None
) -> None:
    assert measured_hz(values, span_s, age_s) == (None if expected is None else pytest.approx(expected))
