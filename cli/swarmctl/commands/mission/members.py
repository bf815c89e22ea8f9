"""The members of a running mission, from the boards that the joined node receives."""

import math
import time
from typing import Final

import msgspec

from swarmctl.commandline.nodes import EVERY, NodeSelection, is_selection, joined, names_one
from swarmctl.commands.mission.member_lines import (
    MemberProgress,
    change_line,
    display_key,
    member_table,
)
from swarmctl.resources.fanout import ask_all
from swarmctl.session.session import Session
from swarmctl.vehicles.observer import first_of
from swarmctl.vehicles.selection import mission_states
from swarmware.errors import NotFound, Partial, SwarmError
from swarmware.model import names
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import INACTIVE, NOT_STARTED, MissionPhase, MissionState, MissionStatus
from swarmware.types.navigation import NavStatus
from swarmware.types.rpc import Empty
from swarmware.types.vehicle import Pose

UNSUCCESSFUL: Final = INACTIVE - {MissionPhase.DONE}
SILENT_S: Final = 5.0
"""A member sends its state once a second; the command stops waiting for a member that missed five."""


class ActiveMission(msgspec.Struct, frozen=True):
    """A run of a mission and its members."""

    mission: str
    epoch: int
    members: tuple[str, ...]
    kinds: dict[str, PlatformKind]
    """Kinds of the members, as far as known."""
    plays: bool
    """True unless the run has ended at every member."""
    ordered_by: str = ""
    """User that started the mission, as `user@platform` by its members, or "" if none answered."""


class MemberState(msgspec.Struct, frozen=True):
    """A changed state of a member."""

    platform: str
    state: MissionState


async def find_active(session: Session) -> ActiveMission:
    """The active run, else the newest one: of the platform that `-n` names, else of any.

    The queried platform need not be a member itself.
    Raises: NotFound without such a mission.
    """
    states = mission_states(session)
    if names_one(session.settings.node):
        found = await session.ask("sys/mission/status", Empty(), MissionStatus)
        if not found.state.epoch:
            raise NotFound(f"{found.platform}: no mission was started; expected one")
        return _ensemble(found.state.epoch, {**states, found.platform: found.state}, [found])
    runs = {state.epoch for state in states.values() if state.epoch}
    if not runs:
        raise NotFound(f"{session.here}: no mission was started; expected one")
    playing = {state.epoch for state in states.values() if state.epoch and state.state not in INACTIVE}
    # a later run has a greater epoch, unless the number wrapped, as it does every 50 days
    epoch = max(playing or runs)
    # boards carry neither the members nor the sender of the order
    asked = [name for name, state in states.items() if state.epoch == epoch]
    answers, _ = await ask_all(session, asked, "sys/mission/status", Empty(), MissionStatus)
    return _ensemble(epoch, states, [answer for answer in answers.values() if answer.state.epoch == epoch])


def _ensemble(epoch: int, states: dict[str, MissionState], answers: list[MissionStatus]) -> ActiveMission:
    inside = {name: state for name, state in states.items() if state.epoch == epoch}
    kinds = {name: state.kind for name, state in inside.items()}
    for answer in answers:
        kinds |= {member.platform: member.kind for member in answer.members}
    members = tuple(sorted(kinds, key=names.natural))
    plays = any(state.state not in INACTIVE for state in inside.values())
    mission = next((state.mission for state in inside.values() if state.mission), "mission")
    ordered_by = next((answer.ordered_by for answer in answers if answer.ordered_by), "")
    return ActiveMission(mission, epoch, members, kinds, plays, ordered_by)


class _MotionBoards:
    """Boards of the members that a terminal shows beside their mission states."""

    def __init__(self, session: Session) -> None:
        module = session.module
        self._poses = module.readers("/*/nav/pose", Pose)
        self._navs = module.readers("/*/nav/status", NavStatus)

    def progress(self, platform: str, state: MissionState | None, since_s: float) -> MemberProgress:
        """The newest values of a member."""
        pose, nav = self._poses.get(platform), self._navs.get(platform)
        at = None if pose is None else pose.value
        goal = None if nav is None else nav.value
        if at is None:
            return MemberProgress(state, since_s)
        speed_m_s = math.hypot(at.vx_m_s, at.vy_m_s, at.vz_m_s)
        return MemberProgress(state, since_s, at.z_m, goal.distance_m if goal else None, speed_m_s)


async def follow(session: Session, epoch: int, members: tuple[str, ...]) -> None:
    """Shows the states of the members in this run until it has ended at all of them.

    On a terminal each member has one line, which is redrawn; elsewhere each change is a line with its time.
    Raises: SwarmError when it was unsuccessful at a member, Partial when a member sent no state.
    """
    others = session.module.readers("/*/mission/state", MissionState)
    own = session.module.reader("mission/state", MissionState)
    boards = _MotionBoards(session) if session.out.redraws else None
    begin_ns = session.module.now_ns()
    shown: dict[str, MissionState] = {}
    since: dict[str, int] = {}
    last_change: dict[str, tuple[int | None, int]] = {}
    silent: set[str] = set()
    while True:
        now_ns = session.module.now_ns()
        for platform in members:
            reader = own if platform == session.here else others.get(platform)
            state = None if reader is None else reader.value
            stamp_ns = None if reader is None else reader.stamp_ns
            if platform not in last_change or last_change[platform][0] != stamp_ns:
                last_change[platform] = (stamp_ns, now_ns)
                silent.discard(platform)
            # a board shows the previous run until its member has received the order
            if state is not None and state.epoch == epoch:
                changed = platform not in shown or display_key(state) != display_key(shown[platform])
                shown[platform] = state
                if changed:
                    since[platform] = now_ns
                    _print_change(session, platform, state)
            ended = platform in shown and shown[platform].state in INACTIVE
            if not ended and now_ns - last_change[platform][1] > SILENT_S * 1e9 and platform not in silent:
                silent.add(platform)
                session.out.warn(f"{platform}: no state received for {SILENT_S:g} s")
        ended_by = {platform for platform, state in shown.items() if state.state in INACTIVE}
        over = ended_by | silent >= set(members)
        if boards is not None:
            found = {
                name: boards.progress(name, shown.get(name), (now_ns - since.get(name, begin_ns)) / 1e9)
                for name in members
            }
            title = next((state.mission for state in shown.values() if state.mission), "mission")
            table = member_table(title, (now_ns - begin_ns) / 1e9, found, session.out.width)
            session.out.redraw(table, last=over)
        if over:
            break
        # at least once a second, to notice silence and to redraw the times
        await first_of(own.changed(), others.changed(), timeout_s=1.0)
    _raise_unsuccessful(shown, ended_by, silent)


def _raise_unsuccessful(shown: dict[str, MissionState], ended_by: set[str], silent: set[str]) -> None:
    bad = sorted(
        (platform for platform in ended_by if shown[platform].state in UNSUCCESSFUL), key=names.natural
    )
    # first, because a silent member may have failed as well
    if silent:
        raise Partial(f"mission: {', '.join(sorted(silent, key=names.natural))} sent no state before its end")
    if bad:
        name = next((shown[p].mission for p in bad if shown[p].mission), "")
        raise SwarmError(f"mission {name}: unsuccessful at {', '.join(_how(p, shown[p]) for p in bad)}")


def _how(platform: str, state: MissionState) -> str:
    """How the mission ended at a member, with the reason."""
    how = "not started" if state.state == NOT_STARTED else str(state.state)
    return f"{platform} ({how}: {state.text})" if state.text and state.text != how else f"{platform} ({how})"


def _print_change(session: Session, platform: str, state: MissionState) -> None:
    if session.settings.structured:
        session.out.line(MemberState(platform, state))
    elif not session.out.redraws:
        session.out.now(change_line(time.strftime("%H:%M:%S"), platform, state))


async def watch(session: Session, platforms: tuple[str, ...]) -> None:
    """Follows the active mission of all its members, or of the selected ones.

    Raises: NotFound for a platform that is not a member; as `follow`.
    """
    await session.check_selected("")
    found = await find_active(session)
    node = session.settings.node
    words = joined(platforms) or (node if is_selection(node) else EVERY)
    members = NodeSelection(words).choose(found.members, f"the run of {found.mission}")
    if found.ordered_by:
        session.out.say(f"{found.mission}: ordered by {found.ordered_by}")
    await follow(session, found.epoch, tuple(members))
