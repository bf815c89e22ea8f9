"""A machine of its own: a small Debian that boots systemd, in a container of systemd-nspawn."""

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Final, Self

ROOT: Final = Path(__file__).parents[2]
SUITE: Final = "bookworm"
PACKAGES: Final = (
    *("systemd", "systemd-sysv", "dbus", "polkitd", "python3", "python3-venv", "nftables"),
    *("openssh-server", "openssh-client"),
    "libpam-systemd",  # debootstrap does not find the virtual package on which polkitd depends
)
BOOT_S: Final = 30.0
COMMAND_S: Final = 300.0
"""Limit of a script; `pip install` takes the longest, on a loaded computer."""
CGROUPS: Final = (Path("/sys/fs/cgroup/systemd"), Path("/sys/fs/cgroup/unified"))
"""Where a host without a systemd of its own has the hierarchies that the one in the container needs."""
ENVIRONMENT: Final = {
    "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
    "HOME": "/root",
    "LANG": "C.UTF-8",
    "TERM": "dumb",
}


class CannotBoot(Exception):
    """Error of a host without the means to boot a container with systemd, with the reason as its text."""


def why_not() -> str:
    """Why this host can boot no machine, or "" if it may."""
    if os.environ.get("SWARM_BOOT_TEST") != "1":
        return "boots a whole system: asked for by `make boot-test`"
    if os.getuid() != 0:
        return "needs root"
    if missing := [
        name for name in ("systemd-nspawn", "debootstrap", "nsenter", "ip") if not shutil.which(name)
    ]:
        return f"not installed: {', '.join(missing)} (apt-get install systemd-container debootstrap iproute2)"
    return ""


def _cache() -> Path:
    root = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(root) if root else Path("~/.cache").expanduser()) / "swarm" / "boot"


def _key(*words: str) -> str:
    return hashlib.blake2b(" ".join(words).encode(), digest_size=6).hexdigest()


def _made(path: Path, command: list[str]) -> Path:
    """The folder that the command fills (it gets its name at the end); kept for the next run."""
    if not path.is_dir():
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_name(path.name + ".new")
        shutil.rmtree(unfinished, ignore_errors=True)
        done = subprocess.run([*command, str(unfinished)], capture_output=True, text=True, check=False)
        if done.returncode:
            raise CannotBoot(f"{command[0]}: exit {done.returncode}: {(done.stderr or done.stdout)[-400:]}")
        unfinished.rename(path)
    return path


def system() -> Path:
    """The files of the system, never changed by a machine."""
    path = _cache() / f"{SUITE}-{_key(*PACKAGES)}"
    base = _made(path, ["debootstrap", "--variant=minbase", f"--include={','.join(PACKAGES)}", SUITE])
    (base / "etc/hostname").unlink(missing_ok=True)
    return base


def wheels() -> Path:
    """The wheels of all that the package and a build of packages need: the machine has no network."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    needed = project["project"]["dependencies"] + project["build-system"]["requires"]
    needed += project["project"]["optional-dependencies"]["mongo"]
    series = "3.11"  # of the suite
    path = _cache() / f"wheels-{_key(series, platform.machine(), *needed)}"
    download = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
    return _made(path, [*download, f"--python-version={series}", "--only-binary=:all:", *needed, "--dest"])


def ip(*words: str) -> None:
    """Calls the program `ip`; it must succeed."""
    done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"ip {' '.join(words)}: {done.stderr}"


class Cable:
    """Network namespaces of two machines, joined by a pair of interfaces; each is the other's router."""

    def __init__(self) -> None:
        self.ends = tuple(f"swarm{os.getpid()}{letter}" for letter in "ab")

    def __enter__(self) -> Self:
        first, second = self.ends
        for name in self.ends:
            ip("netns", "add", name)
        peer = ("peer", "name", "lan0", "netns", second)
        ip("link", "add", "lan0", "netns", first, "type", "veth", *peer)
        for number, name in enumerate(self.ends, 1):
            ip("-n", name, "address", "add", f"10.0.0.{number}/24", "dev", "lan0")
            for interface in ("lo", "lan0"):
                ip("-n", name, "link", "set", interface, "up")
            ip("-n", name, "route", "add", "default", "via", f"10.0.0.{3 - number}")
        return self

    def __exit__(self, *_: object) -> None:
        for name in self.ends:
            ip("netns", "delete", name)


class Switch:
    """Network namespaces of an operator (10.0.0.254) and of some machines, joined by a bridge."""

    def __init__(self, count: int) -> None:
        self.operator = f"swarm{os.getpid()}o"
        self.ends = tuple(f"swarm{os.getpid()}{number}" for number in range(1, count + 1))

    def __enter__(self) -> Self:
        for name in (self.operator, *self.ends):
            ip("netns", "add", name)
            ip("-n", name, "link", "set", "lo", "up")
        ip("-n", self.operator, "link", "add", "swarm0", "type", "bridge", "mcast_snooping", "0")
        ip("-n", self.operator, "address", "add", "10.0.0.254/24", "dev", "swarm0")
        ip("-n", self.operator, "link", "set", "swarm0", "up")
        for number, name in enumerate(self.ends, 1):
            peer = ("peer", "name", f"port{number}", "netns", self.operator)
            ip("link", "add", "lan0", "netns", name, "type", "veth", *peer)
            ip("-n", self.operator, "link", "set", f"port{number}", "master", "swarm0", "up")
            ip("-n", name, "address", "add", f"10.0.0.{number}/24", "dev", "lan0")
            ip("-n", name, "link", "set", "lan0", "up")
            ip("-n", name, "route", "add", "default", "via", "10.0.0.254")
        return self

    def __exit__(self, *_: object) -> None:
        for name in (*self.ends, self.operator):
            ip("netns", "delete", name)


class Machine:
    """A booted system with a network of its own; all that it wrote is gone with it.

    `folders`: folders of this host, read-only, under /mnt/NAME; `network`: name of its network namespace.
    """

    def __init__(self, hostname: str = "", network: str = "", **folders: Path) -> None:
        self.name = f"swarm{os.getpid()}{hostname}"
        hostname = hostname or self.name
        binds = [f"--bind-ro={path}:/mnt/{name}" for name, path in folders.items()]
        command = [
            *("systemd-nspawn", "--quiet", "--boot", f"--directory={system()}", "--volatile=overlay"),
            *(f"--machine={self.name}", f"--hostname={hostname}", "--console=pipe"),
            f"--network-namespace-path=/run/netns/{network}" if network else "--private-network",
            *("--register=no", "--keep-unit", "--capability=CAP_NET_ADMIN", *binds),
        ]
        self._groups = [root / self.name for root in CGROUPS if root.is_dir()]
        for group in self._groups:
            group.mkdir(exist_ok=True)
        # in cgroups of its own, or it could end none of its services
        enter = "".join(f"echo $$ > {group}/cgroup.procs; " for group in self._groups)
        self._nspawn = subprocess.Popen(
            ["sh", "-c", f'{enter}exec "$@"', "sh", *command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._leader = 0

    def __enter__(self) -> Self:
        deadline_s = time.monotonic() + BOOT_S
        while time.monotonic() < deadline_s and self._nspawn.poll() is None:
            children = Path(f"/proc/{self._nspawn.pid}/task/{self._nspawn.pid}/children").read_text().split()
            self._leader = int(children[0]) if children else 0
            if self._leader and self.run("systemctl is-system-running --wait").stdout.strip() == "running":
                return self
            time.sleep(0.1)  # there is no event before the first process of the container listens
        self._nspawn.kill()
        said = self._nspawn.communicate()[0]
        self._remove_groups()
        raise CannotBoot(f"no system within {BOOT_S} s: {said[-400:]}")

    def run(self, script: str, user: str = "") -> subprocess.CompletedProcess[str]:
        """A shell script of root in /root, or in a login of the user."""
        words = ["su", "--login", user, "--command", script] if user else ["sh", "-ec", f"cd /root; {script}"]
        return subprocess.run(
            ["nsenter", f"--target={self._leader}", "--all", *words],
            capture_output=True,
            text=True,
            check=False,
            stdin=subprocess.DEVNULL,
            env=ENVIRONMENT,
            timeout=COMMAND_S,
        )

    def prepare(self) -> None:
        """Puts the wheel where the reader has it; pip finds all else in a folder, apt has it installed."""
        self.must("cp /mnt/dist/* .")
        self.must("printf '[global]\nno-index = true\nfind-links = /mnt/wheels\n' > /etc/pip.conf")

    def begin(self, script: str) -> "subprocess.Popen[str]":
        """Starts a shell script of root in the background; the caller reads its stdout."""
        return subprocess.Popen(
            ["nsenter", f"--target={self._leader}", "--all", "sh", "-ec", f"cd /root; {script}"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=ENVIRONMENT,
        )

    def must(self, script: str, user: str = "") -> str:
        """What it says on standard output; it must succeed."""
        done = self.run(script, user)
        assert done.returncode == 0, f"{script}\nexit {done.returncode}\n{done.stdout}{done.stderr}"
        return done.stdout

    def __exit__(self, *_: object) -> None:
        self.run("systemctl poweroff")
        try:
            self._nspawn.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            self._nspawn.kill()
            self._nspawn.communicate()
        self._remove_groups()

    def _remove_groups(self) -> None:
        for group in self._groups:
            for folder in sorted((path for path in group.rglob("*") if path.is_dir()), reverse=True):
                folder.rmdir()
            group.rmdir()
