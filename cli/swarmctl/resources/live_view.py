"""A result that is drawn again at its place until it is ended."""

from collections.abc import Awaitable, Callable
from typing import Final

from swarmctl.session.session import Session

PERIOD_S: Final = 1.0
"""Between two drawings."""


class LiveView:
    """Draws what a function returns, once a period; an empty text: the function has printed it."""

    def __init__(self, session: Session, draw: Callable[[], Awaitable[str]]) -> None:
        self._session = session
        self._draw = draw

    async def run(self, count: int | None) -> None:
        """Draws `count` times; None: until it is cancelled.

        On a terminal the text is redrawn at its place; elsewhere one follows the other.
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
