"""What a report needs and an installation without the extra `lab` has not."""

from importlib import import_module
from typing import Final

from swarmware.errors import missing_extra

REPORT_MODULES: Final = ("numpy", "matplotlib")


def require_report(what: str) -> None:
    """Raises: ConfigError naming the extra, when `what` (a command) could not compute and draw a report."""
    for module in REPORT_MODULES:
        try:
            import_module(module)
        except ImportError as error:
            raise missing_extra(what, error, "lab") from error
