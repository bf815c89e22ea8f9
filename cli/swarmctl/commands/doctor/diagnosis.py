"""`swarmctl doctor` as a whole: the checks of this machine and of its node, printed."""

from typing import Final

import msgspec

from swarmctl.commands.doctor.check_result import CheckResult
from swarmctl.commands.doctor.checks import examine
from swarmctl.session.session import local_config_dirs
from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Column
from swarmware.errors import NotFound

WARNINGS: Final = 1
ERRORS: Final = 2


class Diagnosis(msgspec.Struct, frozen=True):
    """Results of all checks."""

    results: list[CheckResult]


def diagnose(out: Output, *, fix: bool) -> int:
    """Prints the result of each check; returns the exit code. Without a node only the machine is checked.

    Raises: NotFound when a given node or lab is not on this machine.
    """
    try:
        folders = local_config_dirs(out.settings)
    except NotFound as error:
        # the default node is optional, a named one must exist
        if out.settings.node or out.settings.lab:
            raise
        out.say(f"{error}; only the machine is checked")
        folders = {}
    results = examine(folders, fix=fix)
    if out.settings.structured:
        out.document(Diagnosis(results))
    else:
        several = len(folders) > 1
        rows = [
            (
                *((result.platform,) if several else ()),
                result.verdict,
                result.check,
                result.text,
                result.advice,
            )
            for result in results
        ]
        columns = [Column("VERDICT"), Column("CHECK"), Column("FOUND"), Column("ADVICE")]
        out.table([*((Column("NODE"),) if several else ()), *columns], rows)
    verdicts = {result.verdict for result in results}
    return ERRORS if "error" in verdicts else WARNINGS if "warning" in verdicts else 0
