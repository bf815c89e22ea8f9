"""Values that the format of an export cannot hold."""

from collections import Counter

from swarmware.errors import Partial


class LostValues:
    """Counts values that are left out of an export, by reason."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def add(self, reason: str) -> None:
        """Count one more value."""
        self._counts[reason] += 1

    def refuse(self) -> None:
        """Check that the export has every value.

        Raises: Partial with the reasons and numbers.
        """
        if self._counts:
            found = [f"{reason}: {count}" for reason, count in sorted(self._counts.items())]
            more = f"; and {len(found) - 3} more reasons" if len(found) > 3 else ""
            text = "; ".join(found[:3])
            raise Partial(f"values are left out of the export: {text}{more}; --format msgpack has all")
