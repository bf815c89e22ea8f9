"""State that all runs of a platform share: numbers of blocks, delay of the event loop, driver by hand."""

from itertools import count

from swarmware.runtime.loop_delay import LoopDelay


class Commons:
    """State that all runs of a platform share."""

    def __init__(self) -> None:
        self.tokens = count(1)
        """Numbers of the running blocks, unique among all runs."""
        self.delay = LoopDelay()
        self.held_by = ""
        """Operator or pilot that drives the vehicle by hand, or "" without one."""
