"""Deadlines by key."""

from swarmware.runtime.timers import Timers


def test_timers_fire_once_in_order() -> None:
    timers: Timers[str] = Timers()
    assert timers.next_ns() is None
    timers.set("a", 30)
    timers.set("b", 10)
    timers.set("c", 20)
    timers.set("a", 5)
    timers.drop("c")
    assert timers.next_ns() == 5
    assert timers.pop(4) is None
    assert [timers.pop(50) for _ in range(3)] == ["a", "b", None]
    timers.set("a", 7)
    timers.set("a", 9)
    timers.set("a", 7)
    assert (timers.pop(8), timers.pop(50)) == ("a", None)
