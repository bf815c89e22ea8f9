"""Paths with equal numbers in frames are found when they are declared, and never mixed."""

import asyncio
from pathlib import Path

import pytest
from tests.equal_numbers import equal_numbers
from tests.unit.tree.pair import core
from tests.unit.tree.units import Units

from swarmd.tree.core.replicas.number_watch import NumberWatch
from swarmware.errors import ConfigError, Conflict
from swarmware.model import template
from swarmware.model.names import data_id
from swarmware.model.resource import Kind, Resource, clash_text, clashes
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.appfile.table import AppTable
from swarmware.types.scalar import Float, Text

ONE, OTHER = equal_numbers()
BOARDS = tuple(Resource(path=path, type="Float", rate_hz=5.0, link="tick") for path in (ONE, OTHER))


def test_the_pair_is_real() -> None:
    assert ONE != OTHER
    assert data_id(ONE, "Float") == data_id(OTHER, "Float")


def test_the_later_path_of_a_pair_is_named() -> None:
    text = Resource(path=OTHER, type="Text")
    branch = Resource(path=OTHER, kind=Kind.BRANCH)
    assert clashes(BOARDS) == {OTHER: BOARDS[0]}
    assert clashes([BOARDS[0], BOARDS[0], text, branch]) == {}
    assert clash_text(OTHER, BOARDS[0]) == (
        f"{OTHER}: its number {BOARDS[0].data_id:#010x} in frames belongs to {ONE} (Float);"
        " expected another name for one of them"
    )


def test_a_template_with_such_a_pair_is_refused(tmp_path: Path) -> None:
    tables = "".join(f'[resources."{path}"]\ntype = "Float"\n' for path in (ONE, OTHER))
    (tmp_path / "kind.toml").write_text(f'description = "a kind"\n{tables}')
    with pytest.raises(ConfigError, match=rf"kind\.toml: key resources: .*{ONE}") as refused:
        template.load("kind", tmp_path)
    assert OTHER in str(refused.value)


async def test_an_application_cannot_declare_such_a_pair(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as module:
        module.writer(ONE, Float).write(Float(1.0))
        with pytest.raises(Conflict, match=f"{OTHER}: its number .* belongs to {ONE}"):
            module.writer(OTHER, Float)
        with pytest.raises(Conflict, match=OTHER):
            module.inbox(OTHER, Float)
        module.writer(OTHER, Text).write(Text("another type has another number"))
        module.inbox(ONE, Float)
        assert module.reader(OTHER, Float).value is None


async def test_two_applications_of_node_cannot_declare_such_pair(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with tmp_node(tmp_path) as node, Module("first", node=node) as first:
        first.inbox(ONE, Float)
        first.writer("payload/more", Float)
        async with Module("second", node=node) as second, asyncio.timeout(20.0):
            while node.table.serving_path(ONE) is None:
                node.table.refresh(probe=True)
                await asyncio.sleep(0)
            with pytest.raises(Conflict, match=f"{OTHER}: its number .* belongs to {ONE}"):
                second.inbox(OTHER, Float)
            with pytest.raises(Conflict, match=OTHER):
                second.writer(OTHER, Float)
            # a program of another user keeps no daemon from its paths: its number may be chosen
            monkeypatch.setattr(AppTable, "of_node", ())
            async with Module("third", node=node) as third:
                third.inbox(OTHER, Float)


def test_later_duplicate_is_omitted_until_first_left(
    caplog: pytest.LogCaptureFixture,
) -> None:
    tree = core("uav1", ())
    one, other = BOARDS
    tree.on_applications([one], [], 0)
    tree.on_applications([one, other], [], 0)
    assert [item.resource.path for item in tree.local.index] == [ONE]
    assert tree.local.refused == {OTHER: clash_text(OTHER, one)}
    assert "its number" in caplog.text
    tree.on_applications([other], [], 0)
    assert OTHER in tree.local.index
    assert tree.local.refused == {}
    planned = core("uav1", (one,))
    planned.on_applications([other], [], 0)
    assert OTHER not in planned.local.index, "the path of the template has the number"


def met(there: tuple[Resource, ...], *patterns: str, own: tuple[Resource, ...] = ()) -> Units:
    uav, gcs = core("uav1", there, templates=()), core("gcs", own, templates=())
    units = Units(uav, gcs)
    gcs.on_applications([], patterns, 0)
    units.meet()
    return units


@pytest.mark.parametrize("patterns", [(f"/uav1/{ONE}",), (f"/uav1/{OTHER}",), ("/uav1/payload/*",)])
def test_equally_numbered_boards_of_another_are_ignored(patterns: tuple[str, ...]) -> None:
    # a node of another version, or a template that was not checked, has both
    units = met(BOARDS, *patterns)
    assert units.trees["gcs"].replicas.wants() == []
    alone = met(BOARDS[:1], *patterns[:1])
    assert {want.path for want in alone.trees["gcs"].replicas.wants()} <= {ONE}


def test_one_of_them_alone_is_received() -> None:
    assert [want.path for want in met(BOARDS[:1], "/uav1/*/*").trees["gcs"].replicas.wants()] == [ONE]


def test_equal_numbers_of_platforms_are_named_fault() -> None:
    tree = met(BOARDS[1:], f"/uav1/{OTHER}", own=BOARDS[:1]).trees["gcs"]
    watch = NumberWatch(tree.local, tree.replicas)
    assert watch.texts() == [clash_text(f"/uav1/{OTHER}", BOARDS[0])]
    assert watch.texts() == watch.texts()
    same = met(BOARDS[:1], f"/uav1/{ONE}", own=BOARDS[:1]).trees["gcs"]
    assert NumberWatch(same.local, same.replicas).texts() == []
    tree.on_applications([BOARDS[1]], [], 0)
    assert clash_text(OTHER, BOARDS[0]) in watch.texts(), "and those here that are refused"
