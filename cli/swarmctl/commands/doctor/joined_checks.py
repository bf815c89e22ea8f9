"""Checks of a node that is joined: its faults, members, links, their outages, and denied requests."""

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Final

from swarmctl.commands.doctor.check_result import CheckResult, Verdict
from swarmctl.commands.doctor.node_findings import ComputerFaults, NodeFindings, query_node
from swarmware.errors import SwarmError
from swarmware.model.clock import utc_ns
from swarmware.types.outage import LinkOutage, OutagePhase

WINDOW_S: Final = 600.0
"""Age up to which an outage counts."""
UNSTEADY: Final = 3
"""Outages of one link in that time, from which it does not hold: a vehicle that passes by causes one."""
REFUSALS_SHOWN: Final = 8
"""Maximum number of lines about denied requests."""

ADVICE: Final = {
    "forward": "it forwards frames that their senders did not sign: revoke it, or upgrade it",
    "late": "a slow link (swarmctl link ls), or another member repeats recorded commands",
    "relay": "revoke it, unless other nodes deny one from which it takes these values",
    "beacon": "a member has the group key and forges: find it by its address, revoke it",
    "key": "compare root, roster and key of `swarmctl keys show` there with `swarmctl keys show NAME` here:"
    " `swarmctl keys invite`, then `swarmctl keys join --replace` there; if a member forges, revoke it",
    "connect": "stop it, or give it keys: swarmctl keys invite; block outsiders by a firewall",
}
"""What to do about a denial, by its verb."""


def check_joined(folder: Path, alive: Collection[str]) -> Iterator[CheckResult]:
    """Findings of the node itself."""
    try:
        present = query_node(folder)
    except SwarmError as error:
        yield CheckResult(
            "faults", "warning", f"the node cannot be joined: {error}", "run swarmctl as its user, or as root"
        )
        return
    own, *others = present.computers
    # without its monitor the check of services has reported the reason
    if "health" in alive:
        yield from _monitored(own, "swarmctl app ls shows whether `health` hangs")
    # no table of services is at hand for the other computers, so each is asked
    for other in others:
        yield from _monitored(other, "swarmctl node ls --units shows whether it answers")
    if present.unreached:
        text = f"members that this node does not reach: {', '.join(present.unreached)}"
        advice = (
            "whether they run; cable or radio; multicast_interface or seeds in broker.toml; UDP port 7447 and"
            " the ports of broker.toml in their firewalls, and in this computer's; the same `root` in"
            " `swarmctl keys show` there"
        )
        yield CheckResult("members", "warning", text, advice)
    elif present.members:
        yield CheckResult("members", "ok", f"all {present.members} other members are reached")
    if present.unanswered:
        text = f"received, but not connected: {', '.join(present.unanswered)}"
        advice = (
            "a link of one direction (`swarmctl link ls`), or they refuse the key of this node:"
            " `swarmctl doctor` there names it"
        )
        yield CheckResult("links", "warning", text, advice)
    yield from check_outages(present)
    for one in present.refusals[:REFUSALS_SHOWN]:
        what = one.path or one.verb
        text = f"{one.sender}: {what}: {one.count} times, last {one.age_s:.0f} s ago"
        advice = ADVICE.get(one.verb, "give the sender that role in the roster or in acl.toml, or stop it")
        yield CheckResult("denied", "warning", f"{text}: {one.reason}", advice)
    if more := present.refusals[REFUSALS_SHOWN:]:
        yield CheckResult(
            "denied", "warning", f"{sum(one.count for one in more)} times in {len(more)} other cases"
        )


def check_outages(present: NodeFindings) -> Iterator[CheckResult]:
    """Outages of links: where vehicles move, several of one link are a problem and one is not."""
    if present.outages is None:
        return
    now_ns = utc_ns()
    lost, unsteady = (", ".join(found(present.outages, now_ns)) for found in (lost_links, unsteady_links))
    if unsteady:
        text = f"links that do not hold, in the last {WINDOW_S / 60:.0f} min: {unsteady}"
        yield CheckResult("outages", "warning", text, "swarmctl link outages; swarmctl link ls shows loss")
    elif present.outages:
        yield CheckResult("outages", "ok", f"links lost now: {lost or 'none'} (swarmctl link outages)")


def _monitored(computer: ComputerFaults, silent: str) -> Iterator[CheckResult]:
    """Faults of one computer of the platform, named where it has several; `silent`: advice without answer."""
    of = f"{computer.computer}: " if computer.computer else ""
    for fault in computer.faults:
        verdict: Verdict = "error" if fault.level == "error" else "warning"
        only = f" -n {computer.computer}" if of else ""
        text = f"{of}{fault.check}: {fault.state}: {fault.what}"
        yield CheckResult("fault", verdict, text, f"swarmctl health faults{only}")
    if computer.silent:
        yield CheckResult("faults", "error", f"{of}{computer.silent}", silent)
    elif not computer.faults:
        yield CheckResult("faults", "ok", f"{of}{'its monitor' if of else 'the node'} has found none")


def lost_links(outages: Iterable[LinkOutage], utc_ns: int) -> list[str]:
    """Links that are lost now, each with its time, the longest first."""
    lost = [one for one in outages if one.phase == OutagePhase.LOST]
    lost.sort(key=lambda one: one.began_utc_ns)
    return [f"{one.name} for {max(0, utc_ns - one.began_utc_ns) / 1e9:.0f} s" for one in lost]


def unsteady_links(outages: Iterable[LinkOutage], utc_ns: int) -> list[str]:
    """Links that were lost again and again, each with number and whole length of its outages."""
    recent: dict[str, list[LinkOutage]] = defaultdict(list)
    for one in outages:
        if utc_ns - one.began_utc_ns < WINDOW_S * 1e9:
            recent[one.name].append(one)
    return [
        f"{name}: {len(found)} outages, {sum(one.down_for_s or 0.0 for one in found):.0f} s in all"
        for name, found in sorted(recent.items())
        if len(found) >= UNSTEADY
    ]
