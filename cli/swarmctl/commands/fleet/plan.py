"""The next step on a host, from the goal and its present state: an interrupted command can be repeated."""

from collections.abc import Collection
from enum import StrEnum
from typing import Final

import msgspec

from swarmware.errors import Conflict, NotFound, SwarmError


class FleetGoal(StrEnum):
    """Goal of a command for a host."""

    PUSH = "push"
    UP = "up"
    DOWN = "down"
    UPGRADE = "upgrade"


class Step(StrEnum):
    """One action on a host."""

    UPLOAD = "upload"
    INSTALL = "install"
    PUSH = "push"
    STOP = "stop"
    START = "start"
    SYNCHRONISE = "synchronise"


class HostStatus(msgspec.Struct, frozen=True):
    """State of a host and its node."""

    installed: bool = False
    """Whether its environment has Swarmware."""
    version: str = ""
    wheel: str = ""
    """SHA-256 of the wheel that `fleet` installed, or "" without one."""
    configured: bool = False
    """Whether it has a node.toml."""
    config: str = ""
    """Digest of the pushed files, or "" if none were pushed or one was changed on the host."""
    running: bool = False
    answers: bool = False
    """Whether the node answers requests."""
    uptime_s: float | None = None
    started_config: str = ""
    """Digest of the configuration with which `fleet` started the node, or "" if it did not."""
    armed: bool | None = None
    """Whether the node is an armed vehicle, or null if it does not answer."""
    resume: bool = False
    """Whether an upgrade stopped the node and has not started it again."""


ABSENT: Final = HostStatus()
"""Status of a host without Swarmware."""


class HostTarget(msgspec.Struct, frozen=True):
    """Target state of a host."""

    goal: FleetGoal
    wheel: str = ""
    """SHA-256 of the wheel, or "" to keep the installed one."""
    config: str = ""
    """Digest of the files to push."""
    synchronise: bool = False
    """Wait until the data of the node are synchronised with the operator's node."""


def next_step(wanted: HostTarget, seen: HostStatus, done: Collection[Step]) -> Step | None:
    """The next step towards the goal, or None if it is reached. `done`: steps of this call.

    Raises: Conflict and NotFound when the goal cannot be reached from here; SwarmError when a step that
    was done had no effect.
    """
    step = _next(wanted, seen, done)
    # without this a step that has no effect would be repeated for ever
    if step is not None and step in done:
        raise SwarmError(f"{step}: done, but the host does not show its effect; expected a change")
    return step


def _next(wanted: HostTarget, seen: HostStatus, done: Collection[Step]) -> Step | None:
    match wanted.goal:
        case FleetGoal.DOWN:
            # also a stopped node that an upgrade would start again: `down` ends that intention
            return Step.STOP if seen.running or seen.resume else None
        case FleetGoal.PUSH:
            return _push(wanted, seen, done)
        case FleetGoal.UPGRADE:
            return _upgrade(wanted, seen, done)
        case FleetGoal.UP:
            return _up(wanted, seen, done)


def _push(wanted: HostTarget, seen: HostStatus, done: Collection[Step]) -> Step | None:
    if wanted.wheel and seen.wheel != wanted.wheel:
        if seen.running:
            raise Conflict(
                f"its node runs {seen.version}; `fleet upgrade` replaces the software of running nodes"
            )
        # no state of the host shows an upload, so only the steps of this call count
        return Step.INSTALL if Step.UPLOAD in done else Step.UPLOAD
    if not seen.installed:
        raise NotFound("Swarmware is not installed; `fleet push --wheel FILE` installs it")
    return Step.PUSH if seen.config != wanted.config else None


def _up(wanted: HostTarget, seen: HostStatus, done: Collection[Step]) -> Step | None:
    if not seen.installed:
        raise NotFound("Swarmware is not installed; `fleet push --wheel FILE` installs it")
    if not seen.configured:
        raise NotFound("no node.toml; `fleet push` brings it")
    if not seen.answers:
        return Step.START
    return Step.SYNCHRONISE if wanted.synchronise and Step.SYNCHRONISE not in done else None


def _upgrade(wanted: HostTarget, seen: HostStatus, done: Collection[Step]) -> Step | None:
    if seen.wheel != wanted.wheel:
        # before the stop, so that the node is down for the installation only
        if Step.UPLOAD not in done:
            return Step.UPLOAD
        return Step.STOP if seen.running else Step.INSTALL  # a running node loads parts of its code later
    # a node that did not run before the upgrade is not started
    if seen.resume or (Step.STOP in done and not seen.answers):
        return Step.START
    started = wanted.synchronise and Step.START in done
    return Step.SYNCHRONISE if started and Step.SYNCHRONISE not in done else None


class HostState(StrEnum):
    """What a command is doing with a host: a step or what precedes it, and the outcome."""

    WAITING = "waiting"
    CONNECT = "connect"
    UPLOAD = "upload"
    INSTALL = "install"
    PUSH = "push"
    STOP = "stop"
    START = "start"
    SYNCHRONISE = "synchronise"
    DONE = "done"
    FAILED = "failed"
    NOT_BEGUN = "not begun"


class FleetStep(msgspec.Struct, frozen=True):
    """Progress of one host: a step that begins, or the outcome."""

    host: str
    state: HostState
    """The step that runs; at the end the outcome: done, failed, not begun."""
    done: bool = False
    """Whether this is the outcome."""
    steps: tuple[Step, ...] = ()
    """Steps that were carried out."""
    synchronised: bool | None = None
    """Whether the data are synchronised with the operator's node, or null if not examined."""
    error: str = ""
    exit_code: int = 0
