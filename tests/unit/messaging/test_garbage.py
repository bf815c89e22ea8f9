"""Whatever comes in at the socket of a process, it is counted, answered or dropped."""

import asyncio
import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st
from tests.patience import PATIENCE_S
from tests.unit.messaging.frames import any_frames

from swarmware.model import names
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.model.names import ANY
from swarmware.node.node import Node
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.transport.messaging.ipc_transport import IpcTransport
from swarmware.types.rpc import Reply

MESSAGES, REQUESTS, NOBODY = 11, 12, 13
HERE = names.hardware_id("uav1")
APP = 5
LAST = 99

frames = any_frames([MESSAGES, REQUESTS, NOBODY], [0, 1, APP, HERE, 77, ANY])
data = st.one_of(st.binary(max_size=120), frames.map(encode))


async def feed(node: Node, sent: list[bytes]) -> None:
    """Another process of the node sends these messages, then a valid message."""
    taken: list[int] = []
    last = asyncio.Event()

    def message(frame: Frame) -> Outcome | None:
        taken.append(frame.sequence)
        if frame.sequence == LAST:
            last.set()
        return Outcome(Status.DELIVERED) if len(taken) % 2 else None

    messaging = node.messaging
    messaging.add_application(APP)
    messaging.serve_messages(MESSAGES, APP, message)
    messaging.serve_requests(REQUESTS, APP, lambda frame, respond: respond(Reply(True, b"")))
    waiting = messaging.send(Frame(FrameKind.MESSAGE, NOBODY, HERE, APP, HERE, sequence=1), 0.05)
    asked = messaging.request(Frame(FrameKind.REQUEST, NOBODY, HERE, APP, HERE, sequence=2), 0.05)
    other = IpcTransport(node.run_dir / "p" / "other", lambda data, connection: None, lambda reason: None)
    for item in [*sent, encode(Frame(FrameKind.MESSAGE, MESSAGES, 77, 1, HERE, sequence=LAST))]:
        assert other.send(messaging.address, item)
    async with asyncio.timeout(PATIENCE_S):
        await last.wait()
    other.close()
    assert isinstance(await waiting, Outcome)
    await asyncio.gather(asked, return_exceptions=True)


@given(st.lists(data, max_size=30))
@settings(deadline=None, max_examples=40)
def test_no_bytes_of_another_process_break_it(sent: list[bytes]) -> None:
    async def run() -> None:
        failures: list[object] = []
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: failures.append(context))
        with tempfile.TemporaryDirectory() as folder:
            async with tmp_node(Path(folder)) as node:
                await feed(node, sent)
        assert failures == []

    asyncio.run(run())


def test_non_frame_is_counted_by_reason(tmp_path: Path) -> None:
    async def run() -> None:
        async with tmp_node(tmp_path) as node:
            answer = Frame(FrameKind.ACK, MESSAGES, 77, 1, HERE, 12345)
            await feed(node, [b"", b"SW", bytes(48), encode(answer)])
            counters = node.messaging.counters()
            assert (counters.malformed, counters.unclaimed_answers) == (3, 1)

    asyncio.run(run())
