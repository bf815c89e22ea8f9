"""Conditions of the broker that operators see: names, access rules, addresses, lateness, serial lines."""

import logging
from typing import Final

from swarmd.broker.core.beacon.beacon_rate import ReportSlowdown
from swarmd.broker.core.membership.sessions import ReportDuplicate
from swarmd.broker.sockets.pinned_addresses import PinnedAddresses
from swarmware.health.monitor import HealthMonitor
from swarmware.model.access_rules import AccessRules
from swarmware.model.acl import FILE as ACL_FILE

ONE_NAME: Final = "One computer for each name"
RULES: Final = f"The access rules of {ACL_FILE} are in force"
IN_TIME: Final = "Beacons are sent when they are due"
PINNED: Final = "This computer has the addresses and interfaces that broker.toml names"
OPEN_LINE: Final = "The serial line of the medium is open"

log = logging.getLogger("swarm.broker")


class Conditions:
    """Reports each condition when it changes."""

    def __init__(self, health: HealthMonitor, access_rules: AccessRules, addresses: PinnedAddresses) -> None:
        self._health = health
        self._access_rules = access_rules
        self._addresses = addresses
        self._access_problem = ""
        self._missing_addresses = ""

    def begin(self) -> None:
        """Reports all conditions as good."""
        self._health.report("name", description=ONE_NAME)
        self._health.report("access", description=RULES)
        self._health.report("processor", description=IN_TIME)
        self._health.report("address", description=PINNED)

    def check(self) -> None:
        """Checks the access rules and the addresses of this computer."""
        self._check_access_rules()
        self._check_addresses()

    def _check_access_rules(self) -> None:
        problem = self._access_rules.problem
        if problem == self._access_problem:
            return
        self._access_problem = problem
        if problem:
            self._health.report("access", "invalid", level="warn", detail=problem, description=RULES)
        else:
            self._health.report("access")

    def _check_addresses(self) -> None:
        missing = self._addresses.missing()
        if missing == self._missing_addresses:
            return
        self._missing_addresses = missing
        if missing:
            log.error("%s", missing)
            self._health.report("address", "gone", detail=missing, description=PINNED)
        else:
            log.warning("all addresses of broker.toml are there again")
            self._health.report("address", description=PINNED)

    def on_duplicate(self, found: ReportDuplicate) -> None:
        """Reports two computers with one name."""
        if found.first:
            log.error(
                "two computers are named %s: %s; change the platform in node.toml of one of them",
                found.platform,
                "this one and another" if found.own else "both are received here",
            )
        self._health.report(
            "name",
            "duplicate",
            level="error" if found.own else "warn",
            detail=f"two computers are named {found.platform}",
            description=ONE_NAME,
            clear_s=5.0,
        )

    def on_duplicate_gone(self) -> None:
        """Reports that each name belongs to one computer again."""
        self._health.report("name")

    def on_slowdown(self, slowdown: ReportSlowdown) -> None:
        """Reports beacons that are late because processor time is short, or that they are in time again."""
        if slowdown.factor == 1:
            self._health.report("processor")
            return
        self._health.report(
            "processor",
            "short",
            level="warn",
            detail=f"beacons slowed {slowdown.factor:.1f} times: half of them were sent"
            f" {slowdown.late_ns / 1e6:.0f} ms late; run fewer services or nodes on this computer",
            description=IN_TIME,
            clear_s=5.0,
        )

    def on_line(self, medium: str, problem: str) -> None:
        """Reports a serial line that cannot be opened, with the reason, or that it is open (empty)."""
        if problem:
            self._health.report(
                f"medium_{medium}", "closed", level="warn", detail=problem, description=OPEN_LINE
            )
        else:
            self._health.report(f"medium_{medium}", description=OPEN_LINE)
