"""Names for annotations in modules that the parent of a node imports, which never evaluates annotations.

A checker of types reads the names of the standard library; at run time each is a placeholder.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from os import PathLike
    from pathlib import Path
    from typing import Final, NoReturn, TypeVar
else:

    class _Annotation:
        """Placeholder of a name that only annotations use."""

        def __init__(self, *_: object) -> None: ...

    Callable = Final = NoReturn = Path = PathLike = Sequence = TypeVar = _Annotation

__all__ = ["TYPE_CHECKING", "Callable", "Final", "NoReturn", "Path", "PathLike", "Sequence", "TypeVar"]
