"""`swarmctl keys join`: gives the node on this computer an identity in the swarm of a token."""

import asyncio
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.membership.activation import activate, show_activation
from swarmctl.membership.node_keys import NodeKeys
from swarmctl.membership.seeds import add_seed
from swarmctl.terminal.output import Output
from swarmctl.terminal.quantities import spoken
from swarmctl.terminal.table import Column
from swarmware.errors import ConfigError, InvalidInput, NoAnswer, SwarmError, WireError
from swarmware.model.clock import utc_ns
from swarmware.transport.enrolment.joiner import CLOCK_S, Credentials, Joiner, from_file
from swarmware.transport.enrolment.messages import ANSWER_MAX, SIZE_BYTES
from swarmware.transport.enrolment.token import JoinToken
from swarmware.transport.sodium import NONCE_BYTES

ADMIT_S: Final = 15.0
"""Maximum wait for the answer, while the inviter signs the roster and gives it to its own node."""


RECEIPT_S: Final = 2.0
"""Maximum time to send the receipt, which fits the buffer of the connection."""


class JoinedSwarm(msgspec.Struct, frozen=True):
    """A node that has an identity in a swarm."""

    platform: str
    swarm: str
    role: str
    serial: int
    members: int
    keys_dir: str
    running: bool
    """Whether the node runs."""
    in_use: bool = False
    """Whether the running node uses these keys."""
    reached: tuple[str, ...] = ()
    """Other members that the node reaches."""
    ahead_s: float | None = None
    """Wall clock of this computer minus the inviter's, or None if unknown."""
    seed: str = ""
    """Inviter's broker as entered in services/broker.toml, or "" if it has no fixed unicast_port."""


def join(out: Output, text: str, file: Path | None, *, replace: bool) -> None:
    """Joins the swarm of a token, and prints the node's membership.

    Raises: InvalidInput for a mistyped token or another platform's, NotFound without a node, Conflict when it
    has an identity, NoAnswer when no inviter answers; Denied for a token that was used or has expired, and
    when a folder cannot be written.
    """
    token = JoinToken.parse(text)
    if file is None:
        _check_network(token)
    node = NodeKeys.find(out.settings)
    node.check_free(replace=replace)
    if file is None:
        credentials = credentials_for(out, token, node.platform, node.pending_seed(), node.write)
    else:
        data, utc_s = file.read_bytes(), utc_ns() // 1_000_000_000
        credentials = from_file(token, node.platform, data, str(file), utc_s)
        node.write(credentials)
    _show(out, node, credentials, _enter_seed(out, node, credentials))


def _enter_seed(out: Output, node: NodeKeys, credentials: Credentials) -> str:
    """Enters the inviter's broker as a seed and returns it, or "" if the broker has no fixed port."""
    # without a fixed port there is nothing to enter, and seeds are IPv4 addresses
    if not credentials.broker_port or ":" in credentials.inviter:
        return ""
    seed = f"{credentials.inviter}:{credentials.broker_port}"
    try:
        add_seed(node, seed)
    except (ConfigError, OSError) as error:
        # not an error: the identity is written, and multicast finds the neighbours on the same network
        out.warn(f"seed {seed} could not be entered: {error}")
        return ""
    return seed


def credentials_for(
    out: Output, token: JoinToken, platform: str, seed: bytes, keep: Callable[[Credentials], None]
) -> Credentials:
    """The inviter's answer to a platform with this key; the inviter gets a receipt after `keep`.

    Raises: InvalidInput for the token of a file; NoAnswer when no inviter answers; Denied for a token that
    was used or has expired; as `keep`.
    """
    _check_network(token)
    return asyncio.run(_ask(token, Joiner(token, platform, seed), keep, out.settings.timeout_s))


def _check_network(token: JoinToken) -> None:
    if not token.hosts:
        raise InvalidInput(
            "token: it belongs to a file; expected --file FILE with the file that `keys invite` wrote"
        )


def _show(out: Output, node: NodeKeys, credentials: Credentials, seed: str) -> None:
    roster = node.load().roster
    member = None if roster is None else roster.find(node.platform)
    if roster is None or member is None:
        raise SwarmError(f"{node.folder}: {node.platform} is not on the roster that was written")
    running = node.runs
    activated = activate(out, node, others=True)
    joined = JoinedSwarm(
        node.platform,
        roster.swarm,
        member.role,
        member.serial,
        len(roster.valid()),
        str(node.folder),
        running,
        activated.in_use,
        activated.reached,
        credentials.ahead_s,
        seed,
    )
    if out.settings.structured:
        out.document(joined)
    else:
        columns = [
            Column("PLATFORM"),
            Column("SWARM"),
            Column("ROLE"),
            Column("MEMBERS", right=True),
            Column("KEYS"),
        ]
        out.table(columns, [(joined.platform, joined.swarm, joined.role, joined.members, joined.keys_dir)])
    if joined.ahead_s is not None and abs(joined.ahead_s) > CLOCK_S:
        way = "ahead of" if joined.ahead_s > 0 else "behind"
        out.warn(
            f"the clock of this computer is {spoken(abs(joined.ahead_s))} {way} the inviter's: times in"
            " its logs will not match; expected a clock set by NTP or by hand (date --set)"
        )
    show_activation(out, node.platform, activated, running=running, others=True)


async def _ask(
    token: JoinToken, joiner: Joiner, keep: Callable[[Credentials], None], connect_s: float
) -> Credentials:
    """The credentials of the first inviter that answers.

    Raises: the sealed refusal of an inviter, else an unsigned refusal with the reason of each address;
    NoAnswer when no address answered; as `keep`.
    """
    # all addresses at once, so that unreachable ones cost a single time-out
    attempts = {
        asyncio.create_task(_connect(host, token.port, connect_s), name=f"connect {host}"): host
        for host in token.hosts
    }
    reasons: list[str] = []
    unsigned: SwarmError | None = None
    try:
        for attempt, host in attempts.items():
            try:
                reader, writer = await attempt
            except OSError as error:  # also a time-out
                reasons.append(f"{host}: {_cause(error, 'no connection in time')}")
                continue
            try:
                try:
                    data = await _exchange(reader, writer, joiner.request(os.urandom(NONCE_BYTES)))
                    found = joiner.on_answer(data, utc_ns())
                except (WireError, OSError, TimeoutError, asyncio.IncompleteReadError) as error:
                    reasons.append(f"{host}: {_cause(error, 'no answer in time')}")
                    continue
                # an unsigned refusal may be forged, so the next address is asked as well
                if isinstance(found, SwarmError):
                    unsigned = unsigned or found
                    reasons.append(f"{host}: {found}")
                    continue
                credentials = msgspec.structs.replace(found, inviter=host)
                keep(credentials)  # before the receipt, which ends the inviter's offer to answer again
                await _send_receipt(writer, joiner.receipt(os.urandom(NONCE_BYTES)))
                return credentials
            finally:
                writer.close()
    finally:
        for attempt in attempts:
            attempt.cancel()
        await asyncio.gather(*attempts, return_exceptions=True)
    if unsigned is not None:
        # the refusal keeps its class, on which the exit code depends
        raise type(unsigned)("; ".join(reasons))
    raise NoAnswer(
        f"no inviter answers on TCP port {token.port}: {'; '.join(reasons)}; expected"
        " `swarmctl keys invite` to run there, and the port to be open in its firewall"
    )


def _cause(error: Exception, late: str) -> str:
    if isinstance(error, asyncio.IncompleteReadError):
        return "the connection ended before the answer; the same line again may succeed"
    return (os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)) or late


async def _connect(
    host: str, port: int, connect_s: float
) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    async with asyncio.timeout(connect_s):
        return await asyncio.open_connection(host, port)


async def _send_receipt(writer: asyncio.StreamWriter, receipt: bytes) -> None:
    """Confirm to the inviter that its answer was not lost."""
    with suppress(TimeoutError, OSError):  # without a receipt the inviter ends, too, half a minute later
        async with asyncio.timeout(RECEIPT_S):
            writer.write(len(receipt).to_bytes(SIZE_BYTES, "big") + receipt)
            await writer.drain()


async def _exchange(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, request: bytes) -> bytes:
    """The answer to a request. Raises: WireError when it is too large; OSError, TimeoutError."""
    async with asyncio.timeout(ADMIT_S):
        writer.write(len(request).to_bytes(SIZE_BYTES, "big") + request)
        await writer.drain()
        size = int.from_bytes(await reader.readexactly(SIZE_BYTES), "big")
        if size > ANSWER_MAX:
            raise WireError(f"an answer of {size} bytes; expected {ANSWER_MAX} at most")
        return await reader.readexactly(size)
