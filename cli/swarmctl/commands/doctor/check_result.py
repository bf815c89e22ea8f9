"""What a check of `swarmctl doctor` found: a verdict, its reason, and the remedy."""

from typing import Literal

import msgspec

Verdict = Literal["ok", "warning", "error"]


class CheckResult(msgspec.Struct, frozen=True):
    """Result of one check."""

    check: str
    verdict: Verdict
    text: str
    advice: str = ""
    fixed: bool = False
    platform: str = ""
    """Platform of the node, or "" for a check of this machine."""
