"""Activation of new keys: the broker of the node here, which reads them at its start, is restarted."""

import asyncio
from typing import Final

from swarmctl.membership.node_keys import NodeKeys
from swarmctl.resources.restart import is_armed, restart_one
from swarmctl.session.session import Session, connect
from swarmctl.terminal.output import Output
from swarmware.errors import NoAnswer, SwarmError
from swarmware.model import names
from swarmware.types.net import Routes
from swarmware.types.rpc import Empty

RESTART_S: Final = 20.0
"""Maximum time until the broker runs again, the same as `start_s` of the guard."""
REACH_S: Final = 10.0
"""Maximum wait for the first other member; neighbours find each other within two seconds."""
POLL_S: Final = 0.25
"""Polling period of the routes, whose board changes not only with new nodes but with each cost."""


class ActivatedKeys:
    """Result of the activation of new keys."""

    def __init__(self, *, in_use: bool = False, reached: tuple[str, ...] = (), reason: str = "") -> None:
        self.in_use = in_use
        """Whether the running node uses the new keys."""
        self.reached = reached
        """Other members that the node reaches."""
        self.reason = reason
        """Why the running node does not use the keys, or "" if it does not run or uses them."""


def activate(out: Output, node: NodeKeys, *, others: bool) -> ActivatedKeys:
    """Restarts the broker with its new keys; with `others`, waits until it reaches another member.

    An armed vehicle is not interrupted.
    """
    if not node.runs:
        return ActivatedKeys()
    try:
        return asyncio.run(_restart(out, node, others=others))
    except SwarmError as error:
        return ActivatedKeys(reason=str(error))


async def _restart(out: Output, node: NodeKeys, *, others: bool) -> ActivatedKeys:
    async with connect(out.settings._replace(config=str(node.config_dir)), out) as session:
        if await is_armed(session):
            return ActivatedKeys(reason=f"{node.platform} is armed")
        await restart_one(session, node.platform, "broker", RESTART_S)
        return ActivatedKeys(in_use=True, reached=await _reached(session) if others else ())


async def _reached(session: Session) -> tuple[str, ...]:
    """The first platforms that have a route, or () if none appears in time."""
    path = names.join(session.here, "sys/broker/routes")
    try:
        async with asyncio.timeout(REACH_S):
            while True:
                try:
                    routes = (await session.ask(path, Empty(), Routes)).routes
                except NoAnswer:
                    routes = ()  # its broker has just been restarted
                if found := [one.platform for one in routes if one.tree_version]:
                    return tuple(sorted(found, key=names.natural))
                await asyncio.sleep(POLL_S)
    except TimeoutError:
        return ()


def show_activation(out: Output, platform: str, found: ActivatedKeys, *, running: bool, others: bool) -> None:
    """Prints whether the node uses its keys, or how to make it use them."""
    if found.in_use and not others:
        out.say(f"{platform} uses these keys now")
    elif found.reached:
        out.say(f"{platform} uses these keys now, and reaches {', '.join(found.reached)}")
    elif found.in_use:
        out.warn(
            f"{platform} uses these keys now, and reaches no other member within {REACH_S:g} s; expected one:"
            " `swarmctl doctor`, and multicast or `seeds` of services/broker.toml"
        )
    elif running:
        out.warn(
            f"{platform} runs and uses these keys after a restart ({found.reason}): `swarmctl node restart"
            f" {platform}`, systemctl restart 'swarmd@*', or end `swarmd node` and start it again"
        )
    else:
        out.say(f"start {platform}: systemctl start swarm.target, or swarmd node")
