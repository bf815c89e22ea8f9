"""What a lab needs of the computer before it starts."""

import os
from pathlib import Path

import pytest

from swarmlab.provision.prerequisites import NODE_BYTES, check_shared_memory
from swarmware.errors import SwarmError


def test_small_shared_memory_is_refused_with_bytes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    total, free = 64 << 20, 3 * NODE_BYTES + 1000
    blocks = os.statvfs_result((1, 1, total, free, free, 0, 0, 0, 0, 255))
    monkeypatch.setattr(os, "statvfs", lambda _: blocks)
    check_shared_memory(Path("/dev/shm"), 3)
    with pytest.raises(SwarmError) as refused:
        check_shared_memory(Path("/dev/shm"), 4)
    assert str(refused.value) == (
        f"shared memory is too small: /dev/shm, {total - free} of {total} bytes are used;"
        f" expected {4 * NODE_BYTES} bytes free for 4 nodes (a larger tmpfs: `docker run --shm-size`)"
    )
