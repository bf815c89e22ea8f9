"""The socket that receives sd_notify: notifications with the sender's pid, and none of other users."""

import os
import socket
from contextlib import closing
from pathlib import Path

import pytest

from swarmware.service.notify import NotificationSocket, Notifier


def test_notification_has_sender_and_last_values() -> None:
    with closing(NotificationSocket()) as notifications:
        with closing(Notifier(notifications.address)) as notifier:
            notifier.ready("15 neighbours")
            notifier.restarted(2, "signal 9")
        assert notifications.receive() == (
            os.getpid(),
            {"READY": "1", "STATUS": "15 neighbours", "MAINPID": str(os.getpid())},
        )
        received = notifications.receive()
        assert received is not None
        assert received[1]["X_RESTARTS"] == "2"
        assert notifications.receive() is None


def test_garbage_is_a_notification_without_known_variables(tmp_path: Path) -> None:
    path = str(tmp_path / "n")
    with (
        closing(NotificationSocket(path)) as notifications,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender,
    ):
        sender.sendto(b"\xff\xfe\0READY\n=1\n" + bytes(5000), path)
        received = notifications.receive()
        assert received is not None
        assert "READY" not in received[1]
    assert not os.path.exists(path)  # noqa: PTH110  # the path is a text here, as in the parent of a node


def test_file_of_killed_receiver_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "n"
    path.touch()
    with closing(NotificationSocket(str(path))) as notifications:
        assert notifications.address == str(path)
    with pytest.raises(OSError, match="No such file"):
        NotificationSocket(str(tmp_path / "missing" / "n"))


@pytest.mark.skipif(os.getuid() != 0, reason="needs a second user")
def test_a_notification_of_another_user_is_ignored() -> None:
    with closing(NotificationSocket()) as notifications:
        child = os.fork()
        if child == 0:
            os.setuid(65_534)
            with closing(Notifier(notifications.address)) as notifier:
                notifier.ready("forged")
            os._exit(0)
        os.waitpid(child, 0)
        assert notifications.receive() is None
