"""An SSH server of its own, and three hosts behind it: folders of this machine, without systemd."""

import getpass
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import psutil
import pytest
from tests.ports import free_port

from swarmctl.session.processes import ProcessIdentity, identity, wait_gone

SSHD = shutil.which("sshd", path="/usr/sbin:/usr/local/sbin")
NAMES = ("gcs", "uav1", "uav2")
MANY = ("broker", "tree", "register", "timesync", "health", "guard", "mission", "hal")


class Fleet(NamedTuple):
    """The file of hosts, and the command of an operator."""

    folder: Path
    env: dict[str, str]

    @property
    def file(self) -> Path:
        return self.folder / "HOSTS.toml"

    def processes(self) -> list[ProcessIdentity]:
        """Processes whose command line names the folder of the hosts."""
        return [
            identity(process.pid)
            for process in psutil.process_iter(["cmdline"])
            if str(self.folder) in " ".join(process.info["cmdline"] or ())
        ]

    def words(self, command: str, *more: str) -> list[str]:
        return [sys.executable, "-m", "swarmctl", "fleet", command, str(self.file), *more]

    def ctl(self, command: str, *more: str) -> "subprocess.CompletedProcess[str]":
        """`swarmctl fleet COMMAND HOSTS.toml …` to its end."""
        done = subprocess.run(
            self.words(command, *more),
            capture_output=True,
            text=True,
            check=False,
            stdin=subprocess.DEVNULL,
            env=self.env,
            timeout=60,
        )
        assert "Traceback" not in done.stderr, done.stderr
        return done


@pytest.fixture(scope="module")
def ssh_port() -> Iterator[tuple[int, Path]]:
    """Port of the server, and the folder with the keys of both sides."""
    if SSHD is None or shutil.which("ssh") is None:
        pytest.skip("no sshd; expected openssh-server and openssh-client")
    folder = Path(tempfile.mkdtemp(prefix="swf", dir="/tmp"))
    server = None
    try:
        for name in ("host", "client"):
            subprocess.run(
                ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / name)], check=True
            )
        shutil.copy(folder / "client.pub", folder / "authorized")
        port = free_port()
        (folder / "known_hosts").write_text(f"[127.0.0.1]:{port} {(folder / 'host.pub').read_text()}")
        options = {
            "Port": port,
            "ListenAddress": "127.0.0.1",
            "HostKey": folder / "host",
            "AuthorizedKeysFile": folder / "authorized",
            "PidFile": "none",
            "StrictModes": "no",
            "UsePAM": "no",
            "PermitRootLogin": "yes",
            "MaxStartups": 100,
        }
        if os.geteuid() == 0:
            Path("/run/sshd").mkdir(exist_ok=True)
        (folder / "sshd_config").write_text("".join(f"{key} {value}\n" for key, value in options.items()))
        server = subprocess.Popen(
            [SSHD, "-D", "-e", "-f", str(folder / "sshd_config")],
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        assert server.stderr is not None
        while "listening" not in (line := server.stderr.readline()):
            assert line, "sshd ended"
        yield port, folder
    finally:
        if server is not None:
            server.send_signal(signal.SIGTERM)
            server.wait(10)
            assert server.stderr is not None
            server.stderr.close()
        shutil.rmtree(folder)


@pytest.fixture
def fleet(ssh_port: tuple[int, Path]) -> Iterator[Fleet]:
    """Three hosts; their nodes are ended."""
    port, keys = ssh_port
    folder = Path(tempfile.mkdtemp(prefix="swf", dir="/tmp"))
    udp_port = free_port()
    (folder / "services").mkdir()
    (folder / "services/broker.toml").write_text(
        f'multicast_group = "239.255.77.77"\nmulticast_interface = "127.0.0.1"\n'
        f'bind_address = "127.0.0.1"\nudp_port = {udp_port}\n'
    )
    out = [
        f'[defaults]\nuser = "{getpass.getuser()}"\nport = {port}\nidentity = "{keys}/client"\n'
        f'known_hosts = "{keys}/known_hosts"\nprefix = "{sys.prefix}"\nsupervisor = "none"\n'
        'services = "services"\n\n'
    ]
    for name in NAMES:
        here = folder / name
        kind, template = ("gcs", "gcs") if name == "gcs" else ("uav", "multirotor")
        services = ", ".join(f'"{one}"' for one in MANY)
        out.append(
            f'[[hosts]]\nname = "{name}"\naddress = "127.0.0.1"\nconfig_dir = "{here}/etc"\n'
            f'[hosts.node]\nkind = "{kind}"\ntemplate = "{template}"\nservices = [{services}]\n'
            f'run_dir = "{here}/run"\ndata_dir = "{here}/data"\nshm_dir = "/dev/shm/{folder.name}-{name}"\n\n'
        )
    (folder / "HOSTS.toml").write_text("".join(out))
    env = {key: value for key, value in os.environ.items() if not key.startswith(("SWARM", "SSH_"))}
    found = Fleet(folder, {**env, "NO_COLOR": "1", "SWARM_CONFIG": f"{folder}/gcs/etc"})
    try:
        yield found
    finally:
        for process in found.processes():
            process.send(signal.SIGKILL)
        assert wait_gone(found.processes(), 10) == []
        shutil.rmtree(folder)
        for left in Path("/dev/shm").glob(f"{folder.name}-*"):
            shutil.rmtree(left)
