"""Names that are similar to an unknown one, for the hint of an error."""

from collections.abc import Iterable


def similar(word: str, known: Iterable[str], *, limit: int = 1, cutoff: float = 0.6) -> list[str]:
    """The known names that are most similar to this one, best match first.

    `cutoff`: minimum similarity, 0 to 1.
    """
    from difflib import get_close_matches  # a process without such an error lives without difflib

    return get_close_matches(word, known, n=limit, cutoff=cutoff)
