"""Results of methods that were coroutines in the last release and now return at once."""

import warnings
from collections.abc import Generator
from typing import Self


class Immediate:
    """Base of the results of `Node.attach`, `share`, `close`, `Module.writer`, `Module.serve` and similar
    methods.

    For one release `await` of such a result still returns the object, with a DeprecationWarning.
    """

    def __await__(self) -> Generator[None, None, Self]:
        warnings.warn(
            f"{type(self).__name__}: returned without waiting; expected no `await`",
            DeprecationWarning,
            stacklevel=2,
        )
        yield from ()
        return self
