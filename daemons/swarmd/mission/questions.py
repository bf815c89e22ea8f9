"""Questions of running blocks to the operator, and the answers that arrive."""

import asyncio

from swarmware.errors import Conflict, NotFound
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.types.mission import BreakpointAnswer
from swarmware.types.rpc import Empty


class Questions:
    """The open questions of this platform's blocks, by the name of the block."""

    def __init__(self, module: Module) -> None:
        self._module = module
        self._open: dict[str, asyncio.Future[bool]] = {}
        module.serve(
            "sys/mission/answer",
            BreakpointAnswer,
            self._on_answer,
            reply=Empty,
            description="Answer the question of a block that waits for the operator",
        )

    async def ask(self, block: str) -> bool:
        """Waits for the answer to the question of a block: whether the mission continues."""
        answer: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        self._open[block] = answer
        try:
            return await answer
        finally:
            if self._open.get(block) is answer:
                del self._open[block]

    def _on_answer(self, answer: BreakpointAnswer, meta: Meta) -> Empty:
        asking = ", ".join(sorted(self._open))
        if not asking:
            raise NotFound(f"{self._module.platform}: no block waits for an answer")
        if not answer.block and len(self._open) > 1:
            raise Conflict(f"several blocks wait for an answer: expected one of {asking}")
        block = answer.block or asking
        if block not in self._open:
            raise NotFound(f"block {block!r}: does not wait for an answer; expected one of {asking}")
        by = self._module.requester(meta)
        self._module.log.info("%s: %s by %s", block, "continue" if answer.proceed else "stop", by)
        waiting = self._open.pop(block)
        if not waiting.done():
            waiting.set_result(answer.proceed)
        return Empty()
