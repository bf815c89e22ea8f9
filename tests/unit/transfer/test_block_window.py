"""How many blocks are on their way, and which comes next."""

from random import Random

from swarmware.transport.transfer.block_window import BLOCKS, TIMEOUTS_S, BlockWindow


def taken(window: BlockWindow) -> list[int]:
    """All blocks that may be sent now."""
    found: list[int] = []
    while (number := window.take(1)) is not None:
        found.append(number)
    return found


def test_window_grows_with_answers_to_limit() -> None:
    window = BlockWindow([(0, 499)], 0)
    assert taken(window) == list(range(int(BLOCKS.window_first)))
    most = 0
    under_way = list(range(int(BLOCKS.window_first)))
    while not window.is_done:
        window.acknowledge(under_way.pop(0), 1)
        under_way += taken(window)
        most = max(most, len(under_way))
    assert most == int(BLOCKS.window_max)


def test_failed_block_goes_first_with_smaller_window() -> None:
    window = BlockWindow([(0, 99)], 0)
    first = taken(window)
    for number in first:
        window.acknowledge(number, 1)
    more = taken(window)
    for number in reversed(more):
        window.fail(number, 1)
    assert taken(window) == more[:1]
    assert not window.is_done


def test_an_answer_after_a_failure_changes_nothing_twice() -> None:
    window = BlockWindow([(3, 3)], 0)
    assert taken(window) == [3]
    window.acknowledge(3, 1)
    window.fail(3, 1)
    assert window.is_done
    assert window.take(1) is None


def test_each_block_is_sent_until_it_arrives() -> None:
    draw = Random(7)
    window, arrived, under_way = BlockWindow([(0, 9), (20, 49)], 0), set[int](), list[int]()
    while not window.is_done:
        under_way += taken(window)
        number = under_way.pop(draw.randrange(len(under_way)))
        if draw.random() < 0.4:
            window.fail(number, 1)
        else:
            window.acknowledge(number, 1)
            arrived.add(number)
    assert arrived == {*range(10), *range(20, 50)}


def test_slow_block_gets_more_time_each_failure() -> None:
    window = BlockWindow([(0, 9)], 0)
    times_s = [window.timeout_s]
    for _ in range(5):
        number = window.take(1)
        assert number == 0
        window.fail(number, 1)
        times_s.append(window.timeout_s)
    assert times_s == [*TIMEOUTS_S, TIMEOUTS_S[-1], TIMEOUTS_S[-1]]
    window.fail(9, 1)
    assert window.timeout_s == TIMEOUTS_S[-1], "one that was not on its way proves nothing"
