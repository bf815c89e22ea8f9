"""What a module opens is there at once; awaiting it still works for one release."""

import warnings
from collections.abc import Generator
from typing import Self


class Immediate:
    """Base of what `Module.writer`, `reader`, `inbox`, `serve` and their like return.

    These methods were coroutines: for one release, `await` still gives the object, with a DeprecationWarning.
    """

    def __await__(self) -> Generator[None, None, Self]:
        warnings.warn(
            f"{type(self).__name__}: it is open at once; expected no `await`",
            DeprecationWarning,
            stacklevel=2,
        )
        yield from ()
        return self
