"""Two real nodes with two paths whose numbers in frames are equal."""

import asyncio
from pathlib import Path

import pytest
from tests.equal_numbers import equal_numbers
from tests.integration.tree.pair import on_uvloop, platforms
from tests.patience import PATIENCE_S

from swarmware.errors import Conflict
from swarmware.types.health import CheckReports
from swarmware.types.scalar import Float

ONE, OTHER = equal_numbers()


@on_uvloop
async def test_equal_numbers_are_refused_or_fault(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "gcs") as (uav, gcs):
        uav.probe.writer(ONE, Float).write(Float(1.0))
        await gcs.until_listed(f"/uav1/{ONE}", lambda entry: entry is not None)
        with pytest.raises(Conflict, match=f"{OTHER}: its number .* belongs to {ONE}"):
            uav.probe.writer(OTHER, Float)
        gcs.probe.writer(OTHER, Float).write(Float(2.0))
        await gcs.until_listed(f"/gcs/{OTHER}", lambda entry: entry is not None)
        checks = gcs.probe.reader("health/checks/tree", CheckReports)
        async with asyncio.timeout(PATIENCE_S):
            while True:
                found = [one for one in (await checks.changed()).reports if one.check == "tree/numbers"]
                if found and found[0].state == "clash":
                    break
        assert f"/uav1/{ONE}" in found[0].freeze
        assert OTHER in found[0].freeze
