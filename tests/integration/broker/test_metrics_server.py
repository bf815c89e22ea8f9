"""The metrics page over a socket: served when configured, and only then."""

import asyncio
import socket
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families
from tests.integration.broker.swarm import on_uvloop, swarm
from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmd.broker.records.metrics_server import CONNECTIONS_MAX
from swarmware.errors import ConfigError


def fetch(port: int, request: bytes) -> bytes:
    """All that comes until the end of the connection."""
    with socket.create_connection(("127.0.0.1", port), timeout=10) as sock:
        sock.sendall(request)
        parts = []
        with suppress(ConnectionResetError):  # it ends while a part of the request has not been read
            while part := sock.recv(1 << 16):
                parts.append(part)
        return b"".join(parts)


async def get(port: int, request: bytes) -> bytes:
    return await asyncio.to_thread(fetch, port, request)


def values(answer: bytes) -> dict[str, float]:
    """Samples without their labels' order, by name and neighbour."""
    assert answer.startswith(b"HTTP/1.1 200 OK\r\n"), answer[:200]
    body = answer.partition(b"\r\n\r\n")[2].decode()
    return {
        f"{one.name} {one.labels.get('neighbour', '')}".strip(): one.value
        for family in text_string_to_metric_families(body)  # type: ignore[no-untyped-call]  # it has no types
        for one in family.samples
    }


PAGE = b"GET /metrics HTTP/1.1\r\nHost: x\r\n"


@on_uvloop
async def test_the_page_has_the_counters_of_the_broker(tmp_path: Path) -> None:
    port = free_port()
    async with swarm(tmp_path, "uav1", "uav2", settings={"uav1": {"metrics_port": port}}) as pair:
        await pair["uav1"].until_up("uav2")
        before = await pair["uav1"].traffic()
        found = values(await get(port, PAGE + b"\r\n"))
        after = await pair["uav1"].traffic()
        assert before.udp_sent_bytes <= found["swarm_udp_sent_bytes_total"] <= after.udp_sent_bytes
        assert found["swarm_link_up uav2"] == 1
        assert (await get(port, b"GET /else HTTP/1.1\r\n\r\n")).startswith(b"HTTP/1.1 404 ")
        assert (await get(port, b"x" * 10_000)).startswith(b"HTTP/1.1 400 ")
        assert (await pair["uav1"].traffic()).refused.scrapes == 2


@on_uvloop
async def test_silent_connections_neither_stop_broker_nor_get_page(tmp_path: Path) -> None:
    port = free_port()
    async with swarm(tmp_path, "uav1", settings={"uav1": {"metrics_port": port}}) as one:
        await one["uav1"].traffic()
        with ExitStack() as silent:
            for _ in range(CONNECTIONS_MAX):
                silent.enter_context(socket.create_connection(("127.0.0.1", port)))
            assert (await get(port, PAGE + b"\r\n")).startswith(b"HTTP/1.1 503 ")
        async with asyncio.timeout(PATIENCE_S):
            while not (await get(port, PAGE + b"\r\n")).startswith(b"HTTP/1.1 200 "):
                await one["uav1"].counters.changed()
        assert (await one["uav1"].traffic()).refused.scrapes >= 1


@on_uvloop
async def test_a_token_opens_the_page(tmp_path: Path) -> None:
    port, file = free_port(), tmp_path / "token"
    await asyncio.to_thread(file.write_text, "secret\n")
    given = {"metrics_port": port, "metrics_token_file": str(file)}
    async with swarm(tmp_path, "uav1", settings={"uav1": given}) as one:
        await one["uav1"].traffic()
        assert (await get(port, PAGE + b"\r\n")).startswith(b"HTTP/1.1 401 ")
        assert values(await get(port, PAGE + b"Authorization: Bearer secret\r\n\r\n"))


@on_uvloop
async def test_port_in_use_and_missing_token_are_named(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        async with swarm(tmp_path / "a", "uav1", settings={"uav1": {"metrics_port": port}}) as one:
            with pytest.raises(ConfigError, match=f"metrics_port {port}"):
                await one["uav1"].ended()
    given = {"metrics_port": free_port(), "metrics_token_file": "/nowhere/token"}
    async with swarm(tmp_path / "b", "uav1", settings={"uav1": given}) as one:
        with pytest.raises(ConfigError, match="/nowhere/token"):
            await one["uav1"].ended()
