"""Rules by which a platform notifies its subscribers: deadband and intervals."""

from swarmctl.resources.limits import MISSION_STATE
from swarmctl.resources.listing import pages
from swarmctl.resources.newest import owned
from swarmctl.session.session import Session
from swarmctl.terminal.quantities import span_s
from swarmctl.terminal.table import Column
from swarmware.model import names
from swarmware.model.names import Pattern
from swarmware.model.resource import Kind
from swarmware.types import registry
from swarmware.types.channel import ChannelLimits, rate_rule
from swarmware.types.tree import TreeRule, TreeRules


async def set_rule(
    session: Session,
    local: str,
    *,
    deadband: float | None,
    min_interval: str,
    max_interval: str,
    reset: bool,
    yes: bool,
) -> None:
    """Sets or removes the rule of a pattern, if given, and prints the rules in force.

    Raises: Denied, NotFound for a rule that is not set, InvalidInput; as `confirm`.
    """
    request = TreeRule(
        Pattern(local).text,
        deadband,
        span_s(min_interval) if min_interval else None,
        span_s(max_interval) if max_interval else None,
        reset,
    )
    target = session.platform
    # before the confirmation: no question about a platform that cannot be asked
    await session.reach(target)
    await session.confirm(yes, _effect(request))
    found = await session.ask(names.join(target, "sys/tree/rule"), request, TreeRules)
    if request.changes and not reset:
        await _warn(session, request)
    if session.settings.structured:
        session.out.document(found)
        return
    columns = [
        Column("PATTERN"),
        Column("DEADBAND", right=True),
        Column("MIN INTERVAL s", right=True),
        Column("MAX INTERVAL s", right=True),
    ]
    rows = [
        (one.pattern, one.deadband or None, one.min_interval_s or None, one.max_interval_s or None)
        for one in found.rules
    ]
    empty = f"{target}: no rule is set; the rules of each subscriber apply"
    session.out.table(columns, rows, empty=empty)


def _effect(request: TreeRule) -> str:
    """Effect of a rule on the swarm that an operator must confirm, or "" if none is needed."""
    slow_s = request.min_interval_s or 0.0
    if slow_s > 0 and Pattern(request.pattern).matches(MISSION_STATE):
        return f"{MISSION_STATE} is sent every {slow_s:g} s at most: barriers of a mission wait for it"
    return ""


async def _warn(session: Session, request: TreeRule) -> None:
    """Warns of resources on which a rule has no effect."""
    found = await pages(session, names.join(session.platform, request.pattern), session.platform)
    valued = [one for one in found.entries if one.kind not in {Kind.BRANCH, Kind.COMMAND, Kind.FILE}]
    if not valued:
        session.out.warn(
            f"{session.platform}: no resource matches {request.pattern} now; the rule is in force"
        )
    await _warn_of_channels(session, request, [names.split(one.path)[1] for one in valued])
    beacon = [names.split(one.path)[1] for one in valued if one.link == "tick"]
    if beacon and (request.deadband or request.max_interval_s):
        session.out.warn(f"{_some(beacon)}: in the beacon, which keeps the min interval only")


async def _warn_of_channels(session: Session, request: TreeRule, paths: list[str]) -> None:
    """Warns of resources whose rate a rule of channels sets, with precedence over an interval."""
    if not request.min_interval_s:
        return
    board = await owned(session, names.join(session.platform, "net/limits"))
    limits = registry.decode(ChannelLimits, board.data).limits
    # rules of files give way to a tree rule, and rules for one receiver concern the others not
    rules = [rule for rule in limits if not rule.from_file and not rule.link]
    if preceded := [path for path in paths if rate_rule(rules, path) is not None]:
        session.out.warn(
            f"{_some(preceded)}: `traffic set --rate` decides the rate, the interval is not in force"
        )


def _some(paths: list[str]) -> str:
    return ", ".join(paths[:3]) + (f" and {len(paths) - 3} more" if len(paths) > 3 else "")
