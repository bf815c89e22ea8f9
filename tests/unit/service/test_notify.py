"""Notifications of a process to its service manager, as datagrams of sd_notify(3)."""

import os
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from swarmware.service.notify import Notifier


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "n"))
        listening.settimeout(5.0)
        yield listening


def received(manager: socket.socket) -> list[str]:
    return manager.recv(4096).decode().splitlines()


SENT: list[tuple[Callable[[Notifier], object], list[str]]] = [
    (lambda one: one.ready("uav1: hal"), ["READY=1", "STATUS=uav1: hal", f"MAINPID={os.getpid()}"]),
    (Notifier.alive, ["WATCHDOG=1"]),
    (lambda one: one.status("4 of 5"), ["STATUS=4 of 5"]),
    (
        lambda one: one.restarted(3, "signal 9"),
        ["STATUS=restart 3: signal 9", "X_RESTARTS=3", "X_REASON=signal 9"],
    ),
    (Notifier.stopping, ["STOPPING=1", "STATUS=stopping"]),
]


@pytest.mark.parametrize(("notify", "lines"), SENT)
def test_each_notification_is_one_datagram(
    manager: socket.socket, notify: Callable[[Notifier], object], lines: list[str]
) -> None:
    notifier = Notifier(manager.getsockname())
    notify(notifier)
    assert received(manager) == lines
    notifier.close()


def test_address_and_watchdog_come_from_environment(
    manager: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", manager.getsockname())
    monkeypatch.setenv("WATCHDOG_USEC", "8000000")
    notifier = Notifier()
    notifier.alive()
    assert received(manager) == ["WATCHDOG=1"]
    assert notifier.watchdog_s == 4.0, "twice in the time of the watchdog"
    notifier.close()


def test_leading_at_sign_is_address_without_file() -> None:
    name = f"swarm-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(f"\0{name}")
        listening.settimeout(5.0)
        notifier = Notifier(f"@{name}")
        notifier.alive()
        assert received(listening) == ["WATCHDOG=1"]
        notifier.close()


@pytest.mark.parametrize("usec", ["", "never", "-5", "1.5"])
def test_watchdog_time_without_number_is_ignored(usec: str) -> None:
    assert Notifier("", usec).watchdog_s is None


def test_without_a_service_manager_notifications_are_dropped(tmp_path: Path) -> None:
    for address in ("", str(tmp_path / "gone")):
        notifier = Notifier(address)
        notifier.ready("uav1")
        assert not notifier.alive(), "nobody receives it"
        notifier.close()


def test_heartbeat_reports_whether_service_manager_receives(tmp_path: Path) -> None:
    address = str(tmp_path / "n")
    notifier = Notifier(address)
    for _ in range(2):
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
            listening.bind(address)
            assert notifier.alive()
        assert not notifier.alive(), "killed: its file is still there"
        Path(address).unlink()
        assert not notifier.alive()
    notifier.close()


def test_a_service_manager_that_reads_nothing_stops_nobody(manager: socket.socket) -> None:
    notifier = Notifier(manager.getsockname())
    for _ in range(5000):
        notifier.status("x" * 200)
    assert received(manager) == [f"STATUS={'x' * 200}"]
    notifier.close()
    notifier.alive()  # closed: dropped
    notifier.close()
