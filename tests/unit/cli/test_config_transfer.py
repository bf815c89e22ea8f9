"""Live settings as a file: all or none, checked before, taken back after a refusal; compared."""

import io
import json
from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.unit.cli.session import GET, LIST, SET, ScriptedSession
from tests.unit.cli.session import value as tree_value

from swarmctl.commands.config.transfer import diff, dump, load
from swarmware.errors import Denied, InvalidInput, NotFound
from swarmware.model.resource import Kind
from swarmware.types.config import EffectiveConfig
from swarmware.types.tree import TreeEntry, TreeListing, TreeSet, TreeSetDone

KP, KI = "/uav1/config/navigator/kp", "/uav1/config/navigator/ki"


class Owner(ScriptedSession):
    """A platform with two settings; its owner refuses to set the setting `refuses`."""

    def __init__(self, refuses: str = "", **options: Any) -> None:
        entries = tuple(
            TreeEntry(path, Kind.SETTING, "Float", unit="1/s", access="rw", range=(0.0, 100.0))
            for path in (KP, KI)
        )
        super().__init__({LIST: TreeListing(entries)}, node="uav1", **options)
        self.refuses = refuses
        self.values = {KP: 1.5, KI: 0.5}
        self.sets: list[tuple[str, float]] = []

    async def ask(
        self, path: str, value: msgspec.Struct, reply: type[Any], *, about: str = "", **rest: Any
    ) -> Any:
        if path == GET:
            return tree_value(about, self.values[about])
        if path == "/uav1/sys/node/config":
            return EffectiveConfig("uav1", ())
        if path == SET:
            assert isinstance(value, TreeSet)
            number = msgspec.msgpack.decode(value.value)
            self.sets.append((about, number))
            if about == self.refuses:
                raise Denied(f"{about}: expected another operator")
            self.values[about] = number
            return TreeSetDone(about, 2, "Float", msgspec.msgpack.encode([number]))
        return await super().ask(path, value, reply, about=about, **rest)


@pytest.fixture(autouse=True)
def no_node(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("SWARM_CONFIG", str(tmp_path))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "uav1.toml"


def fill(file: Path, *lines: str) -> None:
    file.write_text("\n".join(lines))


async def test_dumped_settings_load_and_change_nothing(file: Path) -> None:
    session = Owner()
    await dump(session, str(file))
    await load(session, str(file), yes=False)
    assert session.sets == []
    await dump(session, "")
    assert session.stdout.getvalue() == '"navigator/kp" = 1.5\n"navigator/ki" = 0.5\n'


async def test_only_what_differs_is_set_and_printed(file: Path) -> None:
    fill(file, '"navigator/kp" = 2', '"navigator/ki" = 0.5')
    session = Owner()
    await load(session, str(file), yes=False)
    assert session.sets == [(KP, 2)]
    assert session.stdout.getvalue() == "navigator/kp = 2 (was 1.5)\n"


@pytest.mark.parametrize(
    ("second", "error", "message"),
    [
        ('"navigator/ki" = 101.0', InvalidInput, "navigator/ki: 101; expected 0 to 100 1/s"),
        ('"navigator/ki" = "much"', InvalidInput, "navigator/ki: 'much'; expected a value of type Float"),
        ('"navigator/ki" = true', InvalidInput, "expected a value of type Float"),
        ('"navigator/kd" = 1.0', NotFound, "navigator/kd: no live setting of uav1; expected some of navi"),
    ],
)
async def test_a_file_with_one_unfit_value_sets_nothing(
    file: Path, second: str, error: type[Exception], message: str
) -> None:
    fill(file, '"navigator/kp" = 2.0', second)
    session = Owner()
    with pytest.raises(error, match=message):
        await load(session, str(file), yes=False)
    assert session.sets == []


async def test_refused_value_undoes_values_before_it(file: Path) -> None:
    fill(file, '"navigator/kp" = 2.0', '"navigator/ki" = 3.0')
    session = Owner(refuses=KI)
    with pytest.raises(Denied, match="expected another operator"):
        await load(session, str(file), yes=False)
    assert session.sets == [(KP, 2.0), (KI, 3.0), (KP, 1.5)]
    assert session.values == {KP: 1.5, KI: 0.5}
    assert session.stdout.getvalue() == ""


async def test_settings_are_compared_with_a_file(file: Path) -> None:
    fill(file, '"navigator/kp" = 2.0', '"navigator/ki" = 0.5', '"navigator/kd" = 0.1')
    session = Owner(output="json")
    await diff(session, str(file))
    assert [tuple(one.values()) for one in json.loads(session.stdout.getvalue())["differences"]] == [
        ("navigator/kp", 1.5, 2.0),
        ("navigator/kd", None, 0.1),
    ]
    session = Owner()
    await diff(session, str(file))
    assert "navigator/kp   1.5" in session.stdout.getvalue()
