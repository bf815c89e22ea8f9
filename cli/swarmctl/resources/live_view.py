"""A result that is drawn again at its place until it is ended."""

from collections.abc import Awaitable, Callable
from typing import Final

from swarmctl.session.session import Session

PERIOD_S: Final = 1.0
"""Between two drawings."""
LINES: Final = 24
"""Height of the drawing where stdout is not a terminal."""


class LiveView:
    """Draws what a function returns, once a period; an empty text: the function has printed it."""

    def __init__(self, session: Session, draw: Callable[[], Awaitable[str]]) -> None:
        self._session = session
        self._draw = draw

    async def run(self, count: int | None) -> None:
        """Draws `count` times; None: until it is cancelled.

        On a terminal the text is redrawn at its place, cut at the height; elsewhere one follows the other.
        """
        out = self._session.out
        drawn = 0
        async for _ in self._session.module.every(PERIOD_S):
            text = await self._draw()
            if text and out.redraws:
                out.redraw(cut(text, (out.height or LINES) - 1))
            elif text:
                out.now(text)
            drawn += 1
            if drawn == count:
                return


def cut(text: str, height: int) -> str:
    """The text with at most this number of lines."""
    lines = text.splitlines()
    if len(lines) <= height:
        return text
    return "\n".join([*lines[: height - 1], f"… and {len(lines) - height + 1} more lines"])
