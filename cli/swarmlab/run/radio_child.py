"""The radio of a lab as a child of the process that starts the lab."""

import sys
from collections.abc import Callable

from swarmctl.session.labs import LabState
from swarmlab.run.shared_child import SharedChild


class RadioChild(SharedChild):
    """Starts the radio and watches it: without it no node reaches another one."""

    def __init__(self, lab: LabState, on_change: Callable[[], None]) -> None:
        super().__init__(lab, "radio", [sys.executable, "-m", "swarmlab.radio", lab.folder], on_change)
