"""Records of streams that their link limits."""

import logging

import pytest

from swarmd.tree.records.report import RateLog


def test_log_records_begin_and_end_of_limit(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO, "swarm.tree")
    records = RateLog()
    records.record({})
    records.record({("map/scan", "gcs"): (62.46, "queue of 84 ms")})
    records.record({("map/scan", "gcs"): (31.0, "free"), ("map/scan", "uav2"): (9.0, "queue of 61 ms")})
    records.record({("map/scan", "uav2"): (9.5, "free")})
    assert [record.getMessage() for record in caplog.records] == [
        "map/scan to gcs: the link carries 62.5/s (queue of 84 ms)",
        "map/scan to uav2: the link carries 9.0/s (queue of 61 ms)",
        "map/scan to gcs: the link carries all of it again, or its rate is set",
    ]
