"""What the simulations of brokers share: each signature of a beacon is verified once."""

from functools import lru_cache

import pytest

from swarmd.broker.core.membership.signatures import signature_checks
from swarmware.transport.sodium import verify


@pytest.fixture(autouse=True)
def remembered_signatures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Remembers results, because all receivers of one beacon verify the same bytes with the same key."""
    monkeypatch.setattr(signature_checks, "verify", lru_cache(maxsize=4096)(verify))
