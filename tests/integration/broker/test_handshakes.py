"""A thousand handshakes of each kind of unknown key are refused, counted, logged rarely, shown by doctor."""

import asyncio
import logging
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import pytest
import zmq
from tests.integration.broker.hostile import counted, found_by_doctor
from tests.integration.broker.swarm import on_uvloop, swarm
from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmware.transport.security.keys import Keys
from swarmware.transport.security.root import make_swarm
from swarmware.types.scalar import Text

TRIES = 1000
AT_ONCE = 50
"""Fewer than may wait for authentication: none displaces another."""


class Pair(NamedTuple):
    """Keys of an unknown node."""

    public: bytes
    secret: bytes


def made_keys() -> Pair:
    public, secret = zmq.curve_keypair()
    return Pair(public, secret)


async def shake_hands(port: int, server: bytes, shown: Iterator[Pair | None]) -> None:
    """Connections to uav1, `AT_ONCE` at a time, each until the other end has closed it."""
    loop = asyncio.get_running_loop()
    with zmq.Context() as context:
        for _ in range(TRIES // AT_ONCE):
            with ExitStack() as stack:
                monitors = []
                for _ in range(AT_ONCE):
                    dealer = stack.enter_context(context.socket(zmq.DEALER))
                    dealer.setsockopt(zmq.LINGER, 0)
                    dealer.setsockopt(zmq.RECONNECT_IVL, -1)
                    keys = next(shown)
                    if keys is not None:
                        dealer.setsockopt(zmq.CURVE_SERVERKEY, server)
                        dealer.setsockopt(zmq.CURVE_PUBLICKEY, keys.public)
                        dealer.setsockopt(zmq.CURVE_SECRETKEY, keys.secret)
                    monitors.append(
                        dealer.get_monitor_socket(zmq.EVENT_DISCONNECTED | zmq.EVENT_HANDSHAKE_SUCCEEDED)
                    )
                    stack.callback(monitors[-1].close, 0)
                    stack.callback(dealer.disable_monitor)
                    dealer.connect(f"tcp://127.0.0.1:{port}")
                ends = await loop.run_in_executor(None, _ends, monitors)
                assert set(ends) == {zmq.EVENT_DISCONNECTED}


def _ends(monitors: list["zmq.Socket[bytes]"]) -> list[int]:
    """The first event of each connection; libzmq also closes it where the server denies the handshake."""
    found = []
    for monitor in monitors:
        assert monitor.poll(round(PATIENCE_S * 1000)), "the server keeps a stranger"
        found.append(int.from_bytes(monitor.recv_multipart()[0][:2], "little"))
    return found


@on_uvloop
async def test_unknown_sender_never_proves_key(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    port = free_port()
    make_swarm(tmp_path / "others", {"gcs": "maintainer"})
    async with swarm(tmp_path, "uav1", "gcs", settings={"uav1": {"tcp_port": port}}) as pair:
        owner = pair["uav1"]
        box = owner.app.inbox("cmd/note", Text)
        await pair["gcs"].until_up("uav1")
        member = Keys.load(tmp_path / "keys" / "gcs", "gcs")
        other = Keys.load(tmp_path / "others" / "gcs", "gcs")
        server = member.curve_of("uav1")
        assert server is not None
        copied = Pair(member.curve_public, made_keys().secret)
        kinds: dict[str, Iterator[Pair | None]] = {
            "no key": iter(lambda: None, 0),
            "a copied public key": iter(lambda: copied, None),
            "a key of its own": iter(made_keys, None),
            "a key of another swarm": iter(lambda: Pair(other.curve_public, other.curve_secret), None),
        }
        denied = strangers = 0
        caplog.set_level(logging.INFO)
        for kind, shown in kinds.items():
            await shake_hands(port, server, shown)
            denied += TRIES
            strangers += TRIES * ("own" in kind or "swarm" in kind)
            refused = await counted(owner, "denied_connections", denied)
            assert (refused.denied_connections, refused.unknown_keys) == (denied, strangers), kind

        await owner.until_counted(lambda traffic: traffic.refused.unknown_keys == strangers)
        lines = [record.getMessage() for record in caplog.records]
        assert any("127.0.0.1: its key is not on the roster" in line for line in lines)
        assert len(lines) < 100
        assert any("refused input: " in line and "denied_connections" in line for line in lines)
        assert any("refused input: " in line and "unknown_keys" in line for line in lines)
        table = await found_by_doctor(owner, "refused")
        assert table.verdict == "warning"
        assert f"{strangers} unknown_keys" in table.text
        assert f"{denied} denied_connections" in table.text
        source = await found_by_doctor(owner, "denied")
        assert source.text.startswith("unknown@127.0.0.1: connect: ")
        assert "swarmctl keys invite" in source.advice

        assert await pair["gcs"].app.send("/uav1/cmd/note", Text("member"), timeout_s=PATIENCE_S)
        assert len(box) == 1
