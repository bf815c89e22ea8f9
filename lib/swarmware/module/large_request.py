"""Requests and replies larger than a frame: the caller's side, which sends and requests their parts."""

import asyncio
from collections.abc import Callable, Iterator
from typing import Final, Protocol

import msgspec

from swarmware.errors import WireError
from swarmware.model.frame import Flag, Frame
from swarmware.transport.delivery.large_requests import TAKEN, fetch_element, held_bytes, part_count
from swarmware.types.rpc import Reply

UNDER_WAY: Final = 8
"""Parts without an answer at a time: 256 KiB, whatever the size of the value."""
_BULK: Final = int(Flag.BULK)


class Requests(Protocol):
    """Interface that sends one request."""

    def request(self, frame: Frame, timeout_s: float) -> asyncio.Future[Reply]:
        """Send a request; the future gets the reply."""
        ...


class LargeRequest:
    """One request, with the parts that it or its reply needs."""

    def __init__(self, messaging: Requests, again: Callable[[Frame, bytes], Frame], timeout_s: float) -> None:
        """`again`: a further request to the same address, with this element in its extension."""
        self._messaging = messaging
        self._again = again
        self._loop = asyncio.get_running_loop()
        self._ends_s = self._loop.time() + timeout_s

    async def of_parts(self, parts: Iterator[Frame]) -> Reply:
        """Send a request in parts; the part that completes it gets its reply.

        Raises: NoAnswer, NotFound.
        """
        completed: list[tuple[Frame, Reply]] = []

        def on_reply(part: Frame, reply: Reply) -> bool:
            if reply.ok and reply.kind == TAKEN:
                return False
            completed.append((part, reply))
            return True

        await self._exchange(parts, on_reply)
        if not completed:
            raise WireError("each part of a request was taken, and none completed it")
        return await self.whole(*completed[0])

    async def whole(self, question: Frame, reply: Reply) -> Reply:
        """The reply to a request, with its parts if it is larger than a frame.

        Raises: NoAnswer, NotFound.
        """
        size = held_bytes(reply)
        if size is None:
            return reply
        count = part_count(size)
        numbers: dict[int, int] = {}
        found: dict[int, bytes] = {}
        failed: list[Reply] = []

        def frames() -> Iterator[Frame]:
            for number in range(count):
                frame = self._again(question, fetch_element(question.sequence, number))
                numbers[frame.sequence] = number
                yield frame

        def on_reply(part: Frame, fetched: Reply) -> bool:
            if not fetched.ok:
                failed.append(fetched)
                return True
            found[numbers[part.sequence]] = fetched.body
            return False

        await self._exchange(frames(), on_reply)
        if failed:
            return failed[0]
        body = b"".join(found[number] for number in range(count))
        if len(body) != size:
            raise WireError(f"parts of {len(body)} bytes; expected {size}")
        return msgspec.structs.replace(reply, body=body, kind="")

    async def _exchange(self, frames: Iterator[Frame], on_reply: Callable[[Frame, Reply], bool]) -> None:
        """Send requests, a few at a time, until all have a reply or `on_reply` returns true."""
        under_way: dict[asyncio.Future[Reply], Frame] = {}
        try:
            while True:
                while len(under_way) < UNDER_WAY and (frame := next(frames, None)) is not None:
                    # All parts share one deadline: the caller waits for the whole request.
                    left_s = max(0.0, self._ends_s - self._loop.time())
                    frame.flags |= _BULK
                    under_way[self._messaging.request(frame, left_s)] = frame
                if not under_way:
                    return
                ended, _ = await asyncio.wait(under_way, return_when=asyncio.FIRST_COMPLETED)
                for one in ended:
                    if on_reply(under_way.pop(one), one.result()):
                        return
        finally:
            # The other requests would only load the link: their replies are not awaited any more.
            for one in under_way:
                one.cancel()
