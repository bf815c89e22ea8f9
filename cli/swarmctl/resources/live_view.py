"""A result that is drawn again at its place until it is ended."""

from collections.abc import Awaitable, Callable
from typing import Final

from swarmctl.session.session import Session

PERIOD_S: Final = 1.0
"""Pause between two drawings."""


class LiveView:
    """Draws the text of a function once per period; "" means that the function has printed it itself."""

    def __init__(self, session: Session, draw: Callable[[], Awaitable[str]]) -> None:
        self._session = session
        self._draw = draw

    async def run(self, count: int | None) -> None:
        """Draws `count` times, or until it is cancelled if `count` is None.

        A terminal shows the newest text in place; elsewhere the texts follow each other.
        """
        out = self._session.out
        drawn = 0
        async for _ in self._session.module.every(PERIOD_S):
            text = await self._draw()
            drawn += 1
            if text and out.redraws:
                out.redraw(text, last=drawn == count)
            elif text:
                out.now(*text.split("\n"))
            if drawn == count:
                return
