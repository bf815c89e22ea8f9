"""What tests of hostile senders share: a forged order, and what the broker and `swarmctl doctor` report."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import zmq
from tests.integration.broker.swarm import Station
from tests.patience import PATIENCE_S

from swarmctl.commands.doctor.check_result import CheckResult
from swarmctl.commands.doctor.checks import examine
from swarmware.model.frame import Frame, FrameKind
from swarmware.model.names import data_id, hardware_id
from swarmware.transport.delivery.answer import with_lifetime
from swarmware.transport.security.keys import Keys
from swarmware.types import registry
from swarmware.types.scalar import Text
from swarmware.types.traffic import Refused


async def counted(station: Station, name: str, number: int) -> Refused:
    """The counters when one has reached a number."""
    async with asyncio.timeout(PATIENCE_S):
        while getattr(refused := (await station.traffic()).refused, name) < number:
            pass  # each request waits for its reply
    return refused


async def found_by_doctor(station: Station, check: str) -> CheckResult:
    results = await asyncio.to_thread(examine, {"uav1": station.config_dir}, fix=False)
    return next(result for result in results if result.check == check)


TRIES = 1000


PATH = "cmd/note"


def order(sender: str, number: int, stamp_ns: int, *, hops: int = 24, life_s: float = 5.0) -> Frame:
    """A message from one platform's application to uav1."""
    return Frame(
        FrameKind.MESSAGE,
        data_id(PATH, "Text"),
        hardware_id(sender),
        1,
        hardware_id("uav1"),
        sequence=number,
        stamp_ns=stamp_ns,
        hops_left=hops,
        extension=with_lifetime(life_s),
        payload=registry.encode(Text("hostile")),
    )


@asynccontextmanager
async def dealer(keys: Keys, server: bytes, port: int) -> AsyncIterator["zmq.Socket[bytes]"]:
    """A connection to uav1 with these keys, as no broker makes it."""
    with zmq.Context() as context, context.socket(zmq.DEALER) as made:
        made.setsockopt(zmq.LINGER, 0)
        made.setsockopt(zmq.SNDHWM, 0)
        made.setsockopt(zmq.CURVE_SERVERKEY, server)
        made.setsockopt(zmq.CURVE_PUBLICKEY, keys.curve_public)
        made.setsockopt(zmq.CURVE_SECRETKEY, keys.curve_secret)
        made.connect(f"tcp://127.0.0.1:{port}")
        yield made
