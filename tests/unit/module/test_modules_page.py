"""The code of share/doc/modules.md runs as it is printed."""

import asyncio
import re
from pathlib import Path
from typing import Any

import pytest
from tests.patience import until

from swarmware.model.resource import Kind, Resource
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.register import Application, ApplicationTable, PartnerTable, PartnerUnit

PAGE = Path(__file__).parents[3] / "share/doc/modules.md"


def code(text: str) -> dict[str, Any]:
    """The names that the block of the page with this text defines."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    (block,) = [block for block in blocks if text in block]
    names: dict[str, Any] = {}
    exec(compile(block, str(PAGE), "exec"), names)  # our own page
    return names


async def test_the_module_of_the_page_follows_its_partners(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "swarm.escort")
    async with tmp_node(tmp_path) as node, Module("register", node=node) as register:
        monkeypatch.setenv("SWARM_CONFIG", str(node.config_dir))
        board = register.writer("register/partners", PartnerTable)
        running = asyncio.create_task(code("m.partners()")["main"]())
        try:
            for platform in ("uav2", "uav3"):
                application = Application("planner", 1, 7, 0)
                table = ApplicationTable(platform, "main", 1, 1, 1, "register#1", 0, (application,))
                board.write(PartnerTable((PartnerUnit(table, 1, 0),)))
                await until(lambda: f"planners: ['{platform}']" in caplog.messages)  # noqa: B023
        finally:
            running.cancel()
            await asyncio.wait([running])


async def test_the_code_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = code("TEMPERATURE = ")
    written: dict[Resource, Any] = {}
    write = BoardWriter.write

    def seen(self: BoardWriter[Any], value: Any, stamp_ns: int | None = None) -> int:
        written[self.resource] = value.value
        return write(self, value, stamp_ns)

    monkeypatch.setattr(BoardWriter, "write", seen)
    async with tmp_node(tmp_path) as node:
        monkeypatch.setenv("SWARM_CONFIG", str(node.config_dir))
        await names["main"]()
    assert [(one.path, one.kind, value) for one, value in written.items()] == [
        ("nav/height", Kind.BOARD, 2.0),
        ("motor/temperature", Kind.BOARD, 95.0),
        ("config/motor/limit", Kind.SETTING, 90.0),
        ("motor/trips", Kind.EVENT, "too hot"),
    ]


def test_every_method_of_page_is_one_of_module() -> None:
    methods = set(re.findall(r"`(?:await )?m\.(\w+)\(", PAGE.read_text("utf-8")))
    assert methods > {"writer", "request", "inbox"}
    assert not [method for method in methods if not callable(getattr(Module, method, None))]
