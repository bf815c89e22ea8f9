"""Loss of a medium from the numbers of what arrived."""

import pytest

from swarmd.broker.core.swarm.media.arrivals import WINDOW, Arrivals


def after(*numbers: int) -> float:
    arrivals = Arrivals()
    for number in numbers:
        arrivals.on_number(number)
    return round(arrivals.quality / 255, 2)


@pytest.mark.parametrize(
    ("numbers", "quality"),
    [
        (range(WINDOW), 1.0),
        (range(3), 3 / 8),  # three datagrams prove no perfect medium
        (range(0, 2 * WINDOW, 2), 0.5),
        ([*range(WINDOW), *range(WINDOW)], 1.0),  # copies
        ([1, 0, 3, 2, 5, 4, 7, 6], 1.0),  # overtaken ones are not lost
        (range(0x10000 - 8, 0x10000 + 8), 1.0),  # across the end of the numbers
        ([*range(8), *range(5000, 5008)], 1.0),  # the sender has started again
        ([*range(5000, 5008), *range(8)], 1.0),
    ],
)
def test_loss_is_share_of_numbers_that_are_missing(numbers: list[int], quality: float) -> None:
    assert after(*numbers) == pytest.approx(quality, abs=0.01)
