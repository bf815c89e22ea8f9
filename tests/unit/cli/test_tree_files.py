"""Dumps of the tree: written, compared, loaded all or none; checks of templates and of the live tree."""

import io
from pathlib import Path
from typing import Any

import click
import msgspec
import pytest
from tests.unit.cli.session import GET, LIST, SET, ScriptedSession
from tests.unit.cli.session import value as tree_value

from swarmctl.commands.tree.comparison import diff, differences
from swarmctl.commands.tree.lint import (
    LintLevel,
    contradictions,
    descriptor_findings,
    lint_live,
    template_findings,
)
from swarmctl.commands.tree.snapshot import (
    DumpedResource,
    TreeSnapshot,
    dump,
    load,
    read_snapshot,
    snapshot_bytes,
)
from swarmware.errors import Denied, InvalidInput, NotFound
from swarmware.model.config import share_dir
from swarmware.model.resource import Kind, Resource
from swarmware.types.tree import Quality, TreeEntry, TreeListing, TreeSet, TreeSetDone

KP, KI, FUEL = "/uav1/config/navigator/kp", "/uav1/config/navigator/ki", "/uav1/power/fuel"


class Tree(ScriptedSession):
    """Two settings and a board of uav1, with values; one path may refuse."""

    def __init__(self, refuses: str = "", **options: Any) -> None:
        entries = tuple(
            TreeEntry(
                path, Kind.SETTING, "Float", unit="1/s", access="rw", range=(0.0, 100.0), owner="navigator"
            )
            for path in (KP, KI)
        )
        board = TreeEntry(FUEL, Kind.BOARD, "Float", unit="1", owner="hal")
        super().__init__({LIST: TreeListing((*entries, board))}, **options)
        self.refuses = refuses
        self.values = {KP: 1.5, KI: 0.5, FUEL: 0.75}
        self.sets: list[tuple[str, float]] = []
        self.read: list[str] = []

    async def ask(
        self, path: str, value: msgspec.Struct, reply: type[Any], *, about: str = "", **rest: Any
    ) -> Any:
        if path == GET:
            self.read.append(about)
            return tree_value(about, self.values[about])
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
def no_terminal(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("SWARM_CONFIG", str(tmp_path))


@pytest.mark.parametrize("name", ["uav1.toml", "uav1.json"])
async def test_dump_is_compared_and_loaded_atomically(tmp_path: Path, name: str) -> None:
    file = str(tmp_path / name)
    session = Tree()
    await dump(session, "/uav1", file)
    assert [one.value for one in read_snapshot(file).resources] == [1.5, 0.5, 0.75]
    await diff(session, file, "", values=True)
    assert "no difference" in session.stderr.getvalue()

    session.values |= {KP: 9.0, KI: 8.0, FUEL: 0.1}
    await diff(session, file, "", values=False)
    lines = [line.split() for line in session.stdout.getvalue().splitlines()[1:]]
    assert lines == [[KI, "value", "0.5", "8"], [KP, "value", "1.5", "9"]]
    with pytest.raises(FileNotFoundError):  # no pattern of resources
        await diff(session, str(tmp_path / "none.toml"), "uav1", values=False)
    with pytest.raises(click.UsageError, match="sets 2 settings"):
        await load(session, file, yes=False)
    assert session.sets == []
    await load(session, file, yes=True)
    assert (session.values[KP], session.values[KI], session.values[FUEL]) == (1.5, 0.5, 0.1)
    await load(session, file, yes=False)
    assert len(session.sets) == 2, "what is as in the file is neither set nor asked about"


async def test_values_that_are_not_compared_are_not_read() -> None:
    session = Tree()
    await diff(session, "/uav1", "/uav1", values=False)
    assert sorted(session.read) == [KI, KI, KP, KP]
    await diff(session, "/uav1", "/uav1", values=True)
    assert session.read.count(FUEL) == 2


async def test_load_refused_half_way_is_undone(tmp_path: Path) -> None:
    file = str(tmp_path / "uav1.toml")
    session = Tree(refuses=KI)
    await dump(session, "/uav1", file)
    session.values |= {KP: 9.0, KI: 8.0}
    with pytest.raises(Denied):
        await load(session, file, yes=True)
    assert (session.values[KP], session.values[KI]) == (9.0, 8.0)


@pytest.mark.parametrize(
    ("path", "value", "error"),
    [
        (KP, 101.0, "expected 0 to 100 1/s"),
        (KP, "fast", "expected a value of type Float"),
        ("/uav1/config/navigator/kq", 1.0, "no such setting now; nothing was set"),
    ],
)
async def test_file_with_one_invalid_value_sets_nothing(
    tmp_path: Path, path: str, value: object, error: str
) -> None:
    file = tmp_path / "dump.json"
    resources = tuple(
        DumpedResource(path=one, kind="setting", type="Float", value=what)
        for one, what in ((KI, 3.0), (path, value))
    )
    file.write_bytes(snapshot_bytes(TreeSnapshot(resources=resources), as_json=True))
    session = Tree()
    with pytest.raises((InvalidInput, NotFound), match=error):
        await load(session, str(file), yes=True)
    assert session.sets == []


@pytest.mark.parametrize(
    "content", ["resources = 5", "{", "[[resources]]\npath = 'nav/pose'\nkind = 'board'", "\0", "[]", ""]
)
async def test_file_without_dump_is_refused_by_name(tmp_path: Path, content: str) -> None:
    file = tmp_path / "dump.toml"
    file.write_text(content)
    with pytest.raises(InvalidInput, match=r"dump\.toml"):
        await load(Tree(), str(file), yes=True)


def test_platforms_are_compared_by_local_path() -> None:
    def side(platform: str, **fields: Any) -> TreeSnapshot:
        pose = DumpedResource(
            path=f"/{platform}/nav/pose", kind="board", type="Pose", value={"a": None, "b": 1}
        )
        gain = DumpedResource(path=f"/{platform}/config/kp", kind="setting", type="Float", **fields)
        return TreeSnapshot(resources=(pose, gain))

    found = differences(side("uav1", value=1.0), side("uav2", value=2.0, unit="1/s"), values=True)
    assert [(one.path, one.field, one.here, one.there) for one in found] == [
        ("config/kp", "unit", "", "1/s"),
        ("config/kp", "value", 1.0, 2.0),
    ]
    short = TreeSnapshot(resources=side("uav1").resources[:1])
    assert [(one.field, one.here) for one in differences(short, side("uav2"), values=False)] == [
        ("resource", None)
    ]
    read = TreeSnapshot(
        resources=(DumpedResource(path="/uav1/nav/pose", kind="board", type="Pose", value={"b": 1.0}),)
    )
    assert differences(short, read, values=True) == [], "TOML has no null"


@pytest.mark.parametrize(
    ("resource", "level", "text"),
    [
        (Resource(path="nav/_pose", type="Pose", owner="x"), "error", "name '_pose'"),
        (Resource(path="a", type="Float", unit="metres", owner="x"), "error", "unit 'metres': not known"),
        (Resource(path="a", type="Float", owner="x"), "warning", "without a unit"),
        (Resource(path="a", type="Text", range=(0, 1), owner="x"), "error", "range of a Text"),
        (
            Resource(path="a", type="Float", unit="m", choices=("b",), owner="x"),
            "error",
            "choices of a Float",
        ),
        (Resource(path="a", type="Pose"), "warning", "no owner"),
        (
            Resource(path="gain", kind=Kind.SETTING, type="Int", default=1, owner="x", range=(0, 2)),
            "warning",
            "a setting outside config/",
        ),
        (
            Resource(path="config/a", kind=Kind.SETTING, type="Int", default=1),
            "warning",
            "without a range",
        ),
        (
            Resource(path="nav/go", kind=Kind.COMMAND, type="Goal", owner="x"),
            "warning",
            "outside cmd/ and sys/",
        ),
    ],
    ids=lambda given: given if isinstance(given, str) else "",
)
def test_each_mistake_of_a_descriptor_is_one_finding(resource: Resource, level: str, text: str) -> None:
    [finding] = descriptor_findings("uav1", resource.path, resource)
    assert finding.level == level
    assert text in finding.text
    good = Resource(path="power/fuel", type="Float", unit="1", range=(0.0, 1.0), owner="hal")
    assert list(descriptor_findings("uav1", good.path, good)) == []


def test_differing_resources_are_named_on_both_platforms() -> None:
    one = Resource(path="a", type="Float", unit="m", owner="x")
    other = Resource(path="a", type="Int", unit="m", owner="x")
    [finding] = contradictions([("uav1", "a", one), ("uav2", "a", other), ("uav3", "a", one)])
    assert (finding.where, finding.level) == ("uav2", LintLevel.ERROR)
    assert finding.text == "type 'Int', but 'Float' of uav1; expected the same of one path"


def test_shipped_templates_are_valid_and_broken_named(tmp_path: Path) -> None:
    found, checked = template_findings(share_dir() / "templates")
    assert found == []
    assert checked > 100
    (tmp_path / "bad.toml").write_text("[resources.a]\nkind = 'x'\n")
    (tmp_path / "odd.toml").write_text(
        "description = 'x'\n[resources.b]\ntype = 'Unknown'\nunit = 'furlong'\nowner = 'x'\n"
    )
    found, _ = template_findings(tmp_path)
    texts = {(one.where, one.path, one.text.partition(":")[0]) for one in found}
    assert ("odd", "b", "unit 'furlong'") in texts
    assert ("odd", "b", "type 'Unknown'") in texts
    assert any(where == "bad" for where, *_ in texts)


async def test_live_tree_error_ends_with_code() -> None:
    lost = TreeEntry("/uav1/power/fuel", Kind.BOARD, "Float", unit="1", owner="hal", quality=Quality.LOST)
    strange = TreeEntry("/uav1/app/x", Kind.BOARD, "Strange", owner="x")
    session = ScriptedSession(
        {
            LIST: TreeListing((lost, strange)),
            "/gcs/sys/tree/type /uav1/sys/tree/type": NotFound("type 'Strange'"),
        },
        output="json",
    )
    with pytest.raises(InvalidInput, match="1 errors in 2 resources"):
        await lint_live(session, "/uav1", None)
    found = session.document["findings"]
    assert [(one["level"], one["path"]) for one in found] == [("error", "app/x"), ("warning", "power/fuel")]
    assert "neither installed here nor described by uav1" in found[0]["text"]
