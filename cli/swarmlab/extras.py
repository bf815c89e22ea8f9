"""Checks that the modules of the extra `lab` are installed."""

from importlib import import_module
from typing import Final

from swarmware.errors import missing_extra

PLANNER: Final = ("numpy",)
"""Module of the path planner of ground vehicles, which every lab has (extra `nav` of a single node)."""
REPORT: Final = (*PLANNER, "matplotlib")


def require(what: str, modules: tuple[str, ...]) -> None:
    """Check the modules that a command needs. Raises: ConfigError naming the extra when one is missing."""
    for module in modules:
        try:
            import_module(module)
        except ImportError as error:
            raise missing_extra(what, error, "lab") from error
