"""Processes that the tests of this folder start: `python actors.py NAME CONFIG_DIR …`."""

import asyncio
import signal
import sys
from collections.abc import Awaitable, Callable

import uvloop

from swarmware.errors import NotFound
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.types.navigation import Goal, GoalKind
from swarmware.types.scalar import Int, Text
from swarmware.types.vehicle import Pose


def say(*words: object) -> None:
    print(*words, flush=True)


async def receive(config_dir: str) -> None:
    """Says each message it gets."""
    async with Module("receiver", config_dir=config_dir) as m:
        inbox = m.inbox("cmd/goto", Goal, limit=4)
        say("ready")
        async for goal in inbox:
            say("goal", goal.seq)


async def relieve(config_dir: str) -> None:
    """Receives from SIGUSR1 on: a restart without the time that an interpreter needs to start."""
    called = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGUSR1, called.set)
    say("waiting")
    await called.wait()
    await receive(config_dir)


async def hoard(config_dir: str) -> None:
    """Never looks into its inbox."""
    async with Module("receiver", config_dir=config_dir) as m:
        m.inbox("cmd/goto", Goal, limit=2)
        say("ready")
        await asyncio.Event().wait()


async def publish(config_dir: str) -> None:
    """Writes a board and a stream."""
    async with Module("publisher", config_dir=config_dir) as m:
        pose = m.writer("nav/pose", Pose, rate_hz=100)
        steps = m.stream_writer("plan/steps", Int)
        say("ready")
        number = 0  # a busy machine skips ticks
        async for _ in m.every(0.01):
            number += 1
            pose.write(Pose(float(number), 0.0))
            steps.write(Int(number))


async def serve(config_dir: str) -> None:
    """Answers requests: right, wrong, slow."""

    async def slow(request: Int, meta: Meta) -> Int:
        await asyncio.sleep(request.value / 1000)
        return request

    def double(request: Int, meta: Meta) -> Int:
        if request.value < 0:
            raise NotFound(f"number {request.value}: none such; expected 0 or more")
        return Int(request.value * 2)

    def broken(request: Text, meta: Meta) -> Text:
        return Text(request.value[10])

    async with Module("server", config_dir=config_dir) as m:
        m.serve("sys/double", Int, double, reply=Int)
        m.serve("sys/slow", Int, slow)
        m.serve("sys/broken", Text, broken)
        say("ready")
        await asyncio.Event().wait()


async def flood(config_dir: str, count: str) -> None:
    """Sends many messages at once and says what became of them."""
    async with Module("flooder", config_dir=config_dir) as m:
        outcomes = await asyncio.gather(
            *(m.send("cmd/goto", Goal(number, GoalKind.GOTO), timeout_s=60) for number in range(int(count)))
        )
        say("delivered", sum(outcome.delivered for outcome in outcomes))


ACTORS: dict[str, Callable[..., Awaitable[None]]] = {
    "receive": receive,
    "relieve": relieve,
    "hoard": hoard,
    "publish": publish,
    "serve": serve,
    "flood": flood,
}


async def act() -> None:
    """SIGTERM ends an actor as it ends a service: everything is left in order."""
    task = asyncio.current_task()
    assert task is not None
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    try:
        await ACTORS[sys.argv[1]](*sys.argv[2:])
    except asyncio.CancelledError:
        say("bye")


if __name__ == "__main__":
    uvloop.run(act())
