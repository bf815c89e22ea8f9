"""The database of a lab behind a radio: the addresses that one socket serves, and the gateway behind it."""

import asyncio
from pathlib import Path

import pytest
from pymongo.uri_parser import parse_uri
from tests.patience import PATIENCE_S

from swarmlab.provision.database import DatabaseServer, address_for_nodes, server_of
from swarmlab.run.database_gateway import DatabaseGateway
from swarmware.errors import InvalidInput

FOLDER = Path("/tmp/labs/formation")


@pytest.mark.parametrize(
    ("uri", "host", "port"),
    [
        ("mongodb://127.0.0.1", "127.0.0.1", 27017),
        ("mongodb://db.example.org:27018/swarm?retryWrites=false", "db.example.org", 27018),
        ("mongodb://user:p%40ss@[::1]:27019/?replicaSet=rs0&directConnection=false", "::1", 27019),
        ("mongodb://h/?tls=true&tlsAllowInvalidHostnames=true", "h", 27017),
    ],
)
def test_nodes_use_socket_with_same_credentials_and_options(uri: str, host: str, port: int) -> None:
    assert server_of(uri) == DatabaseServer(host, port)
    before, after = parse_uri(uri), parse_uri(address_for_nodes(uri, FOLDER))
    assert after["nodelist"] == [(str(FOLDER / "mongodb.sock"), None)]
    assert dict(after["options"]) == {**before["options"], "directConnection": True}
    assert [after[key] for key in ("username", "password", "database")] == [
        before[key] for key in ("username", "password", "database")
    ]


def test_local_server_socket_needs_no_gateway() -> None:
    uri = "mongodb://user:pass@%2Ftmp%2Fmongodb-27017.sock/swarm"
    assert server_of(uri) is None
    assert address_for_nodes(uri, FOLDER) == uri


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("mongodb+srv://user:s3cret@db.example.org/?w=1", "needs several connections"),
        ("mongodb://user:s3cret@a,b:27018/", "needs several connections"),
        ("mongodb://user:s3cret@db.example.org/?tls=true", "expected no TLS"),
        ("mongodb://user:s3cret@db.example.org:seven/", "expected mongodb://host:port"),
    ],
)
def test_address_for_several_connections_or_names_is_refused(uri: str, words: str) -> None:
    with pytest.raises(InvalidInput, match=words) as caught:
        server_of(uri)
    assert "s3cret" not in str(caught.value)


async def test_gateway_carries_both_directions_and_ends_serverless(
    tmp_path: Path,
) -> None:
    async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(await reader.read())
        writer.close()

    socket, data = tmp_path / "mongodb.sock", bytes(range(250)) * 4000
    server = await asyncio.start_server(echo, "127.0.0.1")
    port = server.sockets[0].getsockname()[1]
    gateway = asyncio.create_task(DatabaseGateway(socket, DatabaseServer("127.0.0.1", port)).run())
    try:
        async with asyncio.timeout(PATIENCE_S):
            while not socket.exists():  # noqa: ASYNC110 - a file has no event
                await asyncio.sleep(0)
            reader, writer = await asyncio.open_unix_connection(socket)
            writer.write(data)
            writer.write_eof()
            assert await reader.read() == data
            writer.close()
            server.close()
            await server.wait_closed()
            refused, writer = await asyncio.open_unix_connection(socket)
            assert await refused.read() == b""
            writer.close()
    finally:
        gateway.cancel()
        await asyncio.gather(gateway, return_exceptions=True)
