"""How long a test waits for an event that a quiet computer has at once."""

from typing import Final

PATIENCE_S: Final = 60.0
"""Of a computer that is busy with other tests. What a test proves never depends on it: it only ends the wait
for an event that does not come."""
