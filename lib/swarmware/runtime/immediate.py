"""What was a coroutine and returns at once; awaiting its result still works for one release."""

import warnings
from collections.abc import Generator
from typing import Self


class Immediate:
    """Base of what `Node.attach`, `share`, `close` and the like of `Module.writer`, `serve` return.

    These methods were coroutines: for one release, `await` still gives the object, with a DeprecationWarning.
    """

    def __await__(self) -> Generator[None, None, Self]:
        warnings.warn(
            f"{type(self).__name__}: it is there at once; expected no `await`",
            DeprecationWarning,
            stacklevel=2,
        )
        yield from ()
        return self
