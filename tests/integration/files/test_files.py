"""Files between nodes, as operators send and get them, over a link that loses packets and is cut."""

from pathlib import Path

import pytest
from tests.integration.broker.namespace import figures_of
from tests.integration.files.lossyfile import SERVICES
from tests.integration.tree.pair import on_uvloop, platforms
from tests.patience import PATIENCE_S

from swarmware.errors import Conflict, InvalidInput, OutOfRange
from swarmware.footprint.blake2b import blake2b
from swarmware.types.file import (
    FileBlock,
    FileData,
    FileListing,
    FileOffer,
    FileProgress,
    FileQuery,
    FileRead,
    FileReceived,
)

CONTENT = b"a map"
DIGEST = blake2b(CONTENT, digest_size=32).digest()


@pytest.mark.root
@pytest.mark.parametrize("cut_s", [0.0, 3.0])
def test_file_arrives_whole_over_cut_lossy_link(cut_s: float) -> None:
    seen = figures_of("../files/lossyfile.py", "20", str(cut_s), tools=("ip", "nft"))
    assert seen["sent"]
    assert seen["fetched"]
    assert seen["digests"] == 1
    assert seen["left"] == 0, "nothing incomplete stays"


@on_uvloop
async def test_what_a_node_refuses_of_files_it_says(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", services=SERVICES) as (uav1,):
        await uav1.until_listed("/uav1/sys/files/offer", lambda entry: entry is not None)
        ask = uav1.probe.request
        received = uav1.probe.stream_reader("files/received", FileReceived)
        with pytest.raises(Conflict, match="not offered"):
            await ask("sys/files/write", FileBlock("none", DIGEST, 0, CONTENT), FileProgress)
        with pytest.raises(InvalidInput, match="FileOffer"):
            await ask("sys/files/offer", FileOffer("../../etc/cron.d/x", 5, DIGEST), FileProgress)
        with pytest.raises(OutOfRange, match="file_limit_bytes"):
            await ask("sys/files/offer", FileOffer("large", 1 << 30, DIGEST), FileProgress)
        offer = FileOffer("map", len(CONTENT), DIGEST)
        assert (await ask("sys/files/offer", offer, FileProgress)).missing == ((0, 0),)
        with pytest.raises(InvalidInput, match="digest"):
            await ask("sys/files/write", FileBlock("map", DIGEST, 0, b"a lie"), FileProgress)
        assert not (await ask("sys/files/offer", offer, FileProgress)).complete
        assert (await ask("sys/files/write", FileBlock("map", DIGEST, 0, CONTENT), FileProgress)).complete
        assert (await ask("sys/files/offer", offer, FileProgress)).complete, "it is there"
        assert (await received.next(PATIENCE_S)).name == "map"
        assert (await ask("sys/files/read", FileRead("map", DIGEST, 0), FileData)).data == CONTENT
        with pytest.raises(Conflict, match="changed"):
            await ask("sys/files/read", FileRead("map", bytes(32), 0), FileData)
        [entry] = (await ask("sys/files/list", FileQuery(), FileListing)).files
        assert (entry.name, entry.size_bytes) == ("map", len(CONTENT))
