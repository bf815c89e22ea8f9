"""`swarmctl file`: how long it waits for a node that does not answer its first request."""

from pathlib import Path

import msgspec
import pytest
from tests.unit.cli.session import R, ScriptedSession

from swarmctl.commands.file.getting import get_file
from swarmctl.commands.file.sending import send_file
from swarmware.errors import NoAnswer


class SilentNode(ScriptedSession):
    """A node that does not answer."""

    def __init__(self) -> None:
        super().__init__({})
        self.patience_s: list[float | None] = []

    async def ask(
        self,
        path: str,
        value: msgspec.Struct,
        reply: type[R],
        *,
        about: str = "",
        timeout_s: float | None = None,
    ) -> R:
        self.patience_s.append(timeout_s)
        raise NoAnswer(path)


@pytest.mark.parametrize(("give_up_s", "expected_s"), [(5.0, 5.0), (60.0, 60.0), (3600.0, 60.0)])
async def test_no_request_outlasts_time_to_give_up(
    give_up_s: float, expected_s: float, tmp_path: Path
) -> None:
    (tmp_path / "map.png").write_bytes(b"a map")
    session = SilentNode()
    with pytest.raises(NoAnswer):
        await send_file(session, tmp_path / "map.png", "map.png", give_up_s)
    with pytest.raises(NoAnswer):
        await get_file(session, "map.png", tmp_path, give_up_s)
    assert session.patience_s == [expected_s, expected_s]
