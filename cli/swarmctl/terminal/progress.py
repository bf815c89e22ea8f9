"""Progress of a long operation, on stderr: a bar on a terminal, a line per step elsewhere."""

from types import TracebackType
from typing import Any, Self

from swarmctl.terminal.output import Output
from swarmware.model.visible import visible


class Progress:
    """One long step with a count: `with Progress(out, "starting", 16) as p: p.advance("uav1")`."""

    def __init__(self, out: Output, text: str, total: int) -> None:
        self._out = out
        self._text = text
        self._total = total
        self._bar: Any = None
        self._task: Any = None

    def __enter__(self) -> Self:
        if not self._out.lively:
            self._out.say(self._text)
            return self
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as Bar

        self._bar = Bar(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[note]}"),
            console=Console(stderr=True, no_color=not self._out.colors),
            # the bar disappears, so that only results remain in the scroll-back
            transient=True,
        )
        self._bar.start()
        self._task = self._bar.add_task(self._text, total=self._total, note="")
        return self

    def advance(self, note: str = "") -> None:
        """Count one more step as done."""
        if self._bar is not None:
            self._bar.update(self._task, advance=1, note=visible(note))
        elif note:
            self._out.detail(f"  {note}")

    def at(self, done: float, note: str = "") -> None:
        """Set the number of done steps; a new note is a new line without a terminal."""
        if self._bar is not None:
            self._bar.update(self._task, completed=done, note=visible(note))
        elif note:
            self._out.say(f"  {note}")

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
