"""The receiving end of sd_notify."""

import socket
from pathlib import Path

from swarmlab.run.notify import NotifySocket, Restarts
from swarmware.service.notify import variables


def say(path: Path, *messages: bytes) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.connect(str(path))
        for message in messages:
            sender.send(message)


def test_node_is_ready_from_notification_to_stop(tmp_path: Path) -> None:
    path = tmp_path / "n"
    heard = NotifySocket(path)
    try:
        said: list[tuple[bool, str]] = []
        for messages in (
            [],
            [b"STATUS=loading\nMAINPID=7\n", b"READY=1\nSTATUS=15 neighbours"],
            [b"STOPPING=1"],
        ):
            say(path, *messages)
            heard.drain()
            said.append((heard.ready, heard.status))
        assert said == [(False, ""), (True, "15 neighbours"), (False, "15 neighbours")]
    finally:
        heard.close()
    assert not path.exists()


def test_garbage_changes_nothing(tmp_path: Path) -> None:
    heard = NotifySocket(tmp_path / "n")
    heard.take(variables(b"\xff\xfe\0READY\n=1\nREADY=2"))
    assert not heard.ready
    heard.close()


def test_a_stale_socket_file_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "n"
    first = NotifySocket(path)
    second = NotifySocket(path)
    say(path, b"READY=1")
    second.drain()
    assert second.ready
    first.close()
    second.close()


def test_new_supervisor_restarts_count_and_sum_continues(tmp_path: Path) -> None:
    heard = NotifySocket(tmp_path / "n")
    try:
        heard.take(variables(b"X_RESTARTS=1\nX_REASON=signal 9\nREADY=1"))
        heard.take(variables(b"READY=1"))
        heard.supervisor_died("signal 9")
        assert not heard.ready
        heard.take(variables(b"X_RESTARTS=1\nX_REASON=exit 1"))
        heard.take(variables(b"X_RESTARTS=1\nX_REASON=exit 1"))  # said twice
        assert heard.restarts == Restarts(3, ("signal 9", "parent: signal 9", "exit 1"))
    finally:
        heard.close()


def test_restarts_are_counted_with_reasons_and_unreadiness(tmp_path: Path) -> None:
    heard = NotifySocket(tmp_path / "n")
    try:
        heard.take(variables(b"READY=1"))
        heard.take(variables(b"STATUS=restart 1: signal 9\nX_RESTARTS=1\nX_REASON=signal 9"))
        assert (heard.ready, heard.restarts) == (False, Restarts(1, ("signal 9",)))
        heard.take(variables(b"READY=1"))
        heard.take(variables(b"X_RESTARTS=2\nX_REASON=exit 1"))
        for nonsense in (b"many", b"-3", b"9" * 4000, "٣".encode(), b""):
            heard.take(variables(b"X_RESTARTS=" + nonsense))
        assert str(heard.restarts) == "restarted 2 times (signal 9, exit 1)"
    finally:
        heard.close()
