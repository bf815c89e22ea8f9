"""Segments of a node that runs, was stopped or was killed, and exports: opened by other readers."""

import asyncio
import json
import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import msgpack
import msgspec
import pytest
from mcap.reader import NonSeekingReader, make_reader
from tests.patience import PATIENCE_S

from swarmware.model.config import share_dir
from swarmware.module.module import Module
from swarmware.recorder.ring import segments
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.types.log import LogStats, LogStatsRequest
from swarmware.types.vehicle import Pose


class Cell(msgspec.Struct, frozen=True, array_like=True):
    """One cell of an echo."""

    depth_m: float
    strength_db: float


class Echo(msgspec.Struct, frozen=True, array_like=True):
    """A type of the module, which neither the logger nor `swarmctl` knows."""

    ping: int
    cells: tuple[Cell, ...]


COUNT = 40
TOPIC = "/uav1/test/pose"
ECHO = "/uav1/sonar/echo"
SCRIPT = Path(__file__).with_name("readers.mjs")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Segments as they were while the logger ran, after `kill -9`, and after a regular end; and an export."""
    return asyncio.run(record(tmp_path_factory.mktemp("node")))


async def record(root: Path) -> dict[str, Path]:
    config = make_node(root, services={"logger": {"flush_s": 0.1}})
    log = root / "uav1/data/log"
    files: dict[str, Path] = {}

    def keep(name: str) -> None:
        files[name] = root / f"{name}.mcap"
        shutil.copyfile(segments(log)[-1], files[name])

    async with Module("source", config_dir=config) as module:
        writer = module.stream_writer("test/pose", Pose, kind="event", log="all", slots=512)
        echo = module.writer("sonar/echo", Echo, log="all")

        async def write(first: int) -> None:
            for number in range(first, first + COUNT):
                writer.write(Pose(float(number), 0.5))
            echo.write(Echo(first, (Cell(2.5, -30.0),)))
            request = LogStatsRequest(flush=True)
            await module.request("sys/log/stats", request, LogStats, timeout_s=PATIENCE_S)

        async with spawn(config, "logger") as logger:
            await write(0)
            keep("running")
            await logger.kill()
        keep("killed")
        async with spawn(config, "logger"):
            await write(COUNT)
        keep("stopped")
    files["export"] = root / "export.mcap"
    # in a process of its own, which does not have the module's types
    words = ["log", "export", "--dir", str(log), "--format", "mcap", "--out", str(files["export"])]
    await asyncio.to_thread(subprocess.run, [sys.executable, "-m", "swarmctl", *words], check=True)
    return files


def independent(data: bytes) -> list[tuple[str, dict[str, Any], Any]]:
    """Topic, schema and content of each message, by the specification of MCAP alone."""
    magic = b"\x89MCAP0\r\n"
    assert data.startswith(magic) and data.endswith(magic)
    schemas: dict[int, dict[str, Any]] = {}
    channels: dict[int, tuple[int, str, str]] = {}
    found: list[tuple[str, dict[str, Any], Any]] = []
    at, opcodes = len(magic), []

    def text(body: bytes, at: int) -> tuple[str, int]:
        (length,) = struct.unpack_from("<I", body, at)
        return body[at + 4 : at + 4 + length].decode(), at + 4 + length

    while at < len(data) - len(magic):
        opcode, length = struct.unpack_from("<BQ", data, at)
        body = data[at + 9 : at + 9 + length]
        assert len(body) == length, f"record at {at} is incomplete"
        at += 9 + length
        opcodes.append(opcode)
        if opcode == 3:
            _, behind = text(body, 2)
            _, behind = text(body, behind)
            schemas[int.from_bytes(body[:2], "little")] = json.loads(body[behind + 4 :])
        elif opcode == 4:
            number, schema = struct.unpack_from("<HH", body)
            topic, behind = text(body, 4)
            encoding, _ = text(body, behind)
            channels[number] = schema, topic, encoding
        elif opcode == 5:
            schema, topic, encoding = channels[int.from_bytes(body[:2], "little")]
            assert encoding == "msgpack"
            found.append((topic, schemas[schema], msgpack.unpackb(body[22:])))
    assert opcodes[-1] == 2 and 15 in opcodes
    return found


@pytest.mark.parametrize(("name", "first"), [("running", 0), ("killed", 0), ("stopped", COUNT)])
def test_a_segment_opens_in_readers_of_others(recorded: dict[str, Path], name: str, first: int) -> None:
    path = recorded[name]
    for reader in (make_reader, NonSeekingReader):
        with path.open("rb") as file:
            messages = [m for _, c, m in reader(file).iter_messages() if c.topic == TOPIC]
        assert len(messages) == COUNT
        for message in messages:
            # both times are UTC: the value was sent shortly before it was recorded
            assert 0 <= message.log_time - message.publish_time + 1_000_000 < 60_000_000_000
    contents = independent(path.read_bytes())
    for _, schema, content in contents:
        jsonschema.Draft202012Validator(schema).validate(content)
    poses = [(schema, content) for topic, schema, content in contents if topic == TOPIC]
    fields = [field["title"] for field in poses[0][0]["$defs"]["Pose"]["prefixItems"]]
    assert fields[:2] == ["x_m", "y_m"]
    assert [dict(zip(fields, content, strict=True))["x_m"] for _, content in poses] == [
        float(number) for number in range(first, first + COUNT)
    ]
    ((schema, content),) = [(schema, content) for topic, schema, content in contents if topic == ECHO]
    assert [field["title"] for field in schema["$defs"]["Echo"]["prefixItems"]] == ["ping", "cells"]
    assert [field["title"] for field in schema["$defs"]["Cell"]["prefixItems"]] == ["depth_m", "strength_db"]
    assert content == [first, [[2.5, -30.0]]]


def test_every_exported_message_satisfies_its_schema(recorded: dict[str, Path]) -> None:
    found: dict[str, Any] = {}
    with recorded["export"].open("rb") as file:
        for schema, _, message in make_reader(file).iter_messages():
            assert schema is not None
            found[schema.name] = json.loads(schema.data), json.loads(message.data)
            jsonschema.Draft202012Validator(found[schema.name][0]).validate(found[schema.name][1])
    assert {"Pose", "Echo", "foxglove.PoseInFrame", "foxglove.Log"} <= found.keys()
    schema, content = found["Echo"]
    assert content == {"ping": COUNT, "cells": [{"depth_m": 2.5, "strength_db": -30.0}]}
    assert list(schema["properties"]["cells"]["items"]["properties"]) == ["depth_m", "strength_db"]


def test_javascript_reader_opens_files_with_foxglove_schemas(
    recorded: dict[str, Path], tmp_path: Path
) -> None:
    npm, node = shutil.which("npm"), shutil.which("node")
    if npm is None or node is None:
        pytest.skip("npm and node are not installed")
    packages = ["@mcap/core@2", "fzstd@0.1", "@foxglove/schemas@2.1.0"]
    command = [npm, "install", "--no-audit", "--no-fund", "--silent", *packages]
    done = subprocess.run(
        command, cwd=tmp_path, env=os.environ | {"HOME": str(tmp_path)}, capture_output=True, check=False
    )
    if done.returncode or not (tmp_path / "node_modules/@mcap/core").is_dir():
        pytest.skip(f"npm could not install @mcap/core: {done.stderr.decode()[-200:]}")
    files = [str(path) for path in recorded.values()]
    ours = sorted((share_dir() / "schemas/foxglove").glob("*.json"))
    script = "console.log(JSON.stringify(require('@foxglove/schemas/jsonschema')))"
    official = subprocess.run([node, "-e", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    published = json.loads(official.stdout)
    assert ours and {path.stem: json.loads(path.read_text()) for path in ours} == {
        path.stem: published[path.stem] for path in ours
    }
    read = subprocess.run(
        [node, str(SCRIPT), str(tmp_path), *files], capture_output=True, text=True, check=False
    )
    assert read.returncode == 0, read.stderr
    results = dict(zip(recorded, map(json.loads, read.stdout.splitlines()), strict=True))
    for name in ("running", "killed", "stopped"):
        assert results[name]["messages"] >= COUNT and results[name]["done"], name
        assert results[name]["encodings"] == ["msgpack"]
    assert results["export"]["indexed"] >= 2 * COUNT
