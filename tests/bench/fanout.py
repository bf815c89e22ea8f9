"""A bare fan-out from one process to many over ZeroMQ with CURVE, with the processor load of nodes beside it.

Each receiver is a process on uvloop with one DEALER. It stamps each message and sends the stamp back. Beside
that it works for a share of a core, in equal parts twenty times a second, as a node does. All processes share
the monotonic clock of this machine.
"""

import asyncio
import contextlib
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from time import monotonic_ns
from typing import Final, Self

import uvloop
import zmq

MESSAGE_BYTES: Final = 1200
"""Size of an order for the formation of sixteen, as a datagram."""
PERIOD_S: Final = 0.05
BETWEEN_S: Final = 0.1
STAMP: Final = 8
CONNECTED_S: Final = 20.0

Socket = zmq.Socket[bytes]


def _curve(context: zmq.Context[Socket], kind: int, public: bytes, secret: bytes, server: bytes) -> Socket:
    """A socket with CURVE; without the key of a server it is the server."""
    made = context.socket(kind)
    made.setsockopt(zmq.LINGER, 0)
    made.setsockopt(zmq.CURVE_SECRETKEY, secret)
    if server:
        made.setsockopt(zmq.CURVE_PUBLICKEY, public)
        made.setsockopt(zmq.CURVE_SERVERKEY, server)
    else:
        made.setsockopt(zmq.CURVE_SERVER, 1)
    return made


async def serve(port: int, server: bytes, share: float) -> None:
    """Receives, stamps and answers for ever, and works for this share of a core beside it."""
    public, secret = zmq.curve_keypair()
    end = _curve(zmq.Context(), zmq.DEALER, public, secret, server)
    end.connect(f"tcp://127.0.0.1:{port}")

    def drain() -> None:
        with contextlib.suppress(zmq.Again):
            while True:
                end.recv(zmq.NOBLOCK)
                end.send(monotonic_ns().to_bytes(STAMP, "little"))

    asyncio.get_running_loop().add_reader(int(end.getsockopt(zmq.FD)), drain)
    end.send(b"")
    while True:
        await asyncio.sleep(PERIOD_S)
        ends_s = time.thread_time() + share * PERIOD_S
        while time.thread_time() < ends_s:
            pass
        drain()


class FanOut:
    """The sending process with its connected receivers."""

    def __init__(self, router: Socket, receivers: list[bytes]) -> None:
        self._router = router
        self._receivers = receivers

    @classmethod
    @contextmanager
    def of(cls, receivers: int, share: float) -> Iterator[Self]:
        """A fan-out to this many processes, each of which works for a share of a core beside it."""
        public, secret = zmq.curve_keypair()
        with ExitStack() as stack:
            context = stack.enter_context(zmq.Context[Socket]())
            router = stack.enter_context(_curve(context, zmq.ROUTER, public, secret, b""))
            router.setsockopt(zmq.RCVTIMEO, round(CONNECTED_S * 1e3))
            port = router.bind_to_random_port("tcp://127.0.0.1")
            for _ in range(receivers):
                stack.enter_context(_receiver(port, public, share))
            yield cls(router, [router.recv_multipart()[0] for _ in range(receivers)])

    def receipts_ms(self, bursts: int) -> list[float]:
        """Delays from the begin of each burst to the receipt at each receiver."""
        found = []
        message = bytes(MESSAGE_BYTES)
        for _ in range(bursts):
            time.sleep(BETWEEN_S)
            began_ns = monotonic_ns()
            for receiver in self._receivers:
                self._router.send_multipart([receiver, message])
            for _ in self._receivers:
                _, stamp = self._router.recv_multipart()
                found.append((int.from_bytes(stamp, "little") - began_ns) / 1e6)
        return found


@contextmanager
def _receiver(port: int, server: bytes, share: float) -> Iterator[None]:
    with subprocess.Popen([sys.executable, __file__, str(port), server.decode(), str(share)]) as process:
        try:
            yield
        finally:
            process.kill()


if __name__ == "__main__":
    uvloop.run(serve(int(sys.argv[1]), sys.argv[2].encode(), float(sys.argv[3])))
