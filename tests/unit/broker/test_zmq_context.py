"""The ZeroMQ context: its threads are scheduled ahead of what computes, where the host allows it."""

import os
from pathlib import Path

import pytest
import zmq

from swarmd.broker.sockets.zmq.zmq_socket import IO_NICE, make_context

THREADS = Path("/proc/self/task")
SOCKETS = 16


def nice_of_new_threads(before: set[Path]) -> list[int]:
    return [os.getpriority(os.PRIO_PROCESS, int(thread.name)) for thread in set(THREADS.iterdir()) - before]


def round_trip(context: "zmq.Context[zmq.Socket[bytes]]") -> bytes:
    with context.socket(zmq.PAIR) as one, context.socket(zmq.PAIR) as other:
        port = one.bind_to_random_port("tcp://127.0.0.1")
        other.connect(f"tcp://127.0.0.1:{port}")
        one.send(b"frame")
        return other.recv()


@pytest.mark.skipif(os.geteuid() != 0, reason="needs the right to a nice value below zero")
def test_its_threads_are_scheduled_ahead() -> None:
    before = set(THREADS.iterdir())
    with make_context(SOCKETS) as context:
        assert nice_of_new_threads(before) == [IO_NICE, IO_NICE]
        assert round_trip(context) == b"frame"


def test_a_host_that_forbids_it_costs_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(which: int, who: int, priority: int) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "setpriority", forbidden)
    before = set(THREADS.iterdir())
    with make_context(SOCKETS) as context:
        assert set(nice_of_new_threads(before)) == {os.getpriority(os.PRIO_PROCESS, 0)}
        assert round_trip(context) == b"frame"


def test_it_takes_as_many_sockets_as_asked_for() -> None:
    with make_context(max_sockets=4) as context:
        sockets = [context.socket(zmq.PAIR) for _ in range(3)]
        with pytest.raises(zmq.ZMQError):
            sockets.extend(context.socket(zmq.PAIR) for _ in range(3))
        for socket in sockets:
            socket.close(0)
