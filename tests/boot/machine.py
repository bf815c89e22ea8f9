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
PACKAGES: Final = ("systemd", "systemd-sysv", "dbus", "polkitd", "python3", "python3-venv")
BOOT_S: Final = 30.0
COMMAND_S: Final = 120.0
CGROUPS: Final = (Path("/sys/fs/cgroup/systemd"), Path("/sys/fs/cgroup/unified"))
"""Where a host without a systemd of its own has the hierarchies that the one in the container needs."""
ENVIRONMENT: Final = {
    "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
    "HOME": "/root",
    "LANG": "C.UTF-8",
    "TERM": "dumb",
}


class CannotBoot(Exception):
    """This host lacks what a container with systemd needs; the text is the reason."""


def why_not() -> str:
    """Why this host can boot no machine; empty when it may."""
    if os.environ.get("SWARM_BOOT_TEST") != "1":
        return "boots a whole system: asked for by `make boot-test`"
    if os.getuid() != 0:
        return "needs root"
    if missing := [name for name in ("systemd-nspawn", "debootstrap", "nsenter") if not shutil.which(name)]:
        return f"not installed: {', '.join(missing)} (apt-get install systemd-container debootstrap)"
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
    series = "3.11"  # of the suite
    path = _cache() / f"wheels-{_key(series, platform.machine(), *needed)}"
    download = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
    return _made(path, [*download, f"--python-version={series}", "--only-binary=:all:", *needed, "--dest"])


class Machine:
    """A booted system with a network of its own; all that it wrote is gone with it.

    `folders`: folders of this host, read-only, under /mnt/NAME.
    """

    def __init__(self, **folders: Path) -> None:
        self.name = f"swarm{os.getpid()}"
        binds = [f"--bind-ro={path}:/mnt/{name}" for name, path in folders.items()]
        command = [
            *("systemd-nspawn", "--quiet", "--boot", f"--directory={system()}", "--volatile=overlay"),
            *(f"--machine={self.name}", f"--hostname={self.name}", "--private-network", "--console=pipe"),
            *("--register=no", "--keep-unit", *binds),
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
