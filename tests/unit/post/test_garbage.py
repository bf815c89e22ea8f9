"""Whatever comes in at the socket, the post counts it, answers it or drops it."""

import asyncio
import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from swarmware.model import names
from swarmware.model.frame import Codec, Frame, FrameKind, encode
from swarmware.model.names import ANY
from swarmware.node.node import Node
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.delivery.outcome import Outcome, Status
from swarmware.types import registry
from swarmware.types.rpc import Ack, Reply

MESSAGES, REQUESTS, NOBODY = 11, 12, 13
HERE = names.hardware_id("uav1")
APP = 5

ids = st.sampled_from([0, 1, APP, HERE, 77, ANY])
payloads = st.one_of(
    st.binary(max_size=40),
    st.builds(lambda s, w: registry.encode(Ack(s, w)), st.integers(-3, 9), st.text(max_size=5)),
    st.builds(lambda ok, body: registry.encode(Reply(ok, body)), st.booleans(), st.binary(max_size=5)),
)
frames = st.builds(
    Frame,
    st.sampled_from(FrameKind),
    st.sampled_from([MESSAGES, REQUESTS, NOBODY]),
    ids,
    ids,
    ids,
    ids,
    sequence=st.integers(0, 3),
    stamp_ns=st.integers(-(2**63), 2**63 - 1),
    flags=st.integers(0, 15),
    codec=st.sampled_from(Codec),
    extension=st.binary(max_size=12),
    payload=payloads,
)
data = st.one_of(st.binary(max_size=120), frames.map(encode))


async def feed(node: Node, came: list[bytes]) -> list[int]:
    taken: list[int] = []

    def message(frame: Frame) -> Outcome | None:
        taken.append(frame.sequence)
        return Outcome(Status.DELIVERED) if len(taken) % 2 else None

    post = node.post
    post.add_application(APP)
    post.serve_messages(MESSAGES, APP, message)
    post.serve_requests(REQUESTS, APP, lambda frame, respond: respond(Reply(True, b"")))
    waiting = post.send(Frame(FrameKind.MESSAGE, NOBODY, HERE, APP, HERE, sequence=1), 0.05)
    asked = post.request(Frame(FrameKind.REQUEST, NOBODY, HERE, APP, HERE, sequence=2), 0.05)
    for item in came:
        post._on_data(item, b"\0abcd")
        await asyncio.sleep(0)
    assert isinstance(await waiting, Outcome)
    await asyncio.gather(asked, return_exceptions=True)
    return taken


@given(st.lists(data, max_size=30))
@settings(deadline=None, max_examples=40)
def test_no_bytes_break_the_post(came: list[bytes]) -> None:
    async def run() -> None:
        failures: list[object] = []
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: failures.append(context))
        with tempfile.TemporaryDirectory() as folder:
            async with tmp_node(Path(folder)) as node:
                await feed(node, came)
        assert failures == []

    asyncio.run(run())
