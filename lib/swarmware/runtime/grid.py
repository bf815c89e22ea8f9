"""The grid of a node: multiples of a period on its clock, which all periodic work shares."""


def next_multiple_ns(now_ns: int, period_ns: int, phase_ns: int = 0) -> int:
    """The first multiple of a period after now, each `phase_ns` later."""
    return now_ns + period_ns - (now_ns - phase_ns) % period_ns
