"""What a lab needs and an installation without the extra `lab` has not."""

from importlib import import_module
from typing import Final

from swarmware.errors import missing_extra

PLANNER: Final = ("numpy",)
"""Every lab has a ground vehicle, whose path planner needs it (extra `nav` of a single node)."""
REPORT: Final = (*PLANNER, "matplotlib")


def require(what: str, modules: tuple[str, ...]) -> None:
    """Raises: ConfigError naming the extra, when a module that `what` (a command) needs is not installed."""
    for module in modules:
        try:
            import_module(module)
        except ImportError as error:
            raise missing_extra(what, error, "lab") from error
