"""A node of the lab in a container: chooses its name, writes its configuration, becomes `swarmd node`.

`python -m swarmlab.container` is the entry point of the lab's image (share/swarm/lab).
"""

import fcntl
import os
import socket
import sys
from pathlib import Path
from typing import Any, Final

import tomli_w

from swarmlab.provision.node_files import LIDAR, STATION, TEMPLATES, VEHICLE
from swarmware.errors import ConfigError, SwarmError
from swarmware.model.platform_kind import VEHICLES, PlatformKind
from swarmware.transport.security.root import make_swarm

CONFIG: Final = Path("/etc/swarm")
KEYS: Final = Path("/var/lib/swarm-keys")
"""Volume of the lab, in which the first container makes the keys of the swarm."""
MAX_PER_KIND: Final = 64
"""Number of vehicles of each kind for which keys are made."""
GROUP: Final = "239.255.42.42"
PORT: Final = 17420


def claim(kind: PlatformKind, directory: Path, remembered: Path) -> str:
    """Name of this container's platform: its former one, else the lowest free one.

    The name is locked while this process, or the program that replaces it, runs: containers of one
    service share only the volume.
    Raises: ConfigError when all names are taken.
    """
    names = (
        [kind] if kind == PlatformKind.GCS else [f"{kind}{number}" for number in range(1, MAX_PER_KIND + 1)]
    )
    before = remembered.read_text("utf-8").strip() if remembered.exists() else ""
    directory.mkdir(parents=True, exist_ok=True)
    # the former name first: after a restart the container has its settings and logs again
    for name in sorted(names, key=lambda name: name != before):
        lock = os.open(directory / f"{name}.lock", os.O_RDWR | os.O_CREAT, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            continue
        # the lock must survive `execv`, which replaces this process by the node
        os.set_inheritable(lock, True)
        remembered.parent.mkdir(parents=True, exist_ok=True)
        remembered.write_text(name, "utf-8")
        return name
    raise ConfigError(
        f"platforms {names[0]} to {names[-1]}: all taken; expected at most {len(names)} of {kind}"
    )


def settings(name: str, kind: PlatformKind, address: str, mongodb_uri: str) -> dict[str, dict[str, Any]]:
    """The files of this node, by path below the configuration folder."""
    files: dict[str, dict[str, Any]] = {
        "node.toml": {
            "platform": name,
            "kind": kind,
            "template": TEMPLATES[kind],
            "services": list(STATION if kind == PlatformKind.GCS else VEHICLE),
            "keys_dir": str(KEYS / name),
        },
        "services/broker.toml": {
            "multicast_group": GROUP,
            "multicast_interface": address,
            "bind_address": address,
            "udp_port": PORT,
            # some bridges do not forward multicast: the ground station is also a seed, by name
            "seeds": [] if kind == PlatformKind.GCS else [f"gcs:{PORT}"],
        },
    }
    if mongodb_uri:
        files["services/logger.toml"] = {"mongodb_uri": mongodb_uri, "mongodb_database": "swarm_lab"}
    if name == LIDAR:
        files["services/hal.toml"] = {"drivers": ["sim", "system", "replay"]}
    return files


def share_keys(directory: Path) -> None:
    """Makes the keys of the swarm, in the first container only."""
    directory.mkdir(parents=True, exist_ok=True)
    # all containers start at the same time, and only one may make the keys
    with (directory / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if (directory / "gcs").exists():
            return
        roles = {"gcs": "maintainer"}
        roles |= {f"{kind}{number}": "node" for kind in VEHICLES for number in range(1, MAX_PER_KIND + 1)}
        make_swarm(directory, roles)


def main() -> None:
    """Writes the configuration, then becomes the node."""
    kind = PlatformKind(os.environ.get("SWARM_KIND", PlatformKind.UAV))
    try:
        address = socket.gethostbyname(socket.gethostname())
        share_keys(KEYS)
        name = claim(kind, KEYS / "claims", Path("/var/lib/swarm/platform"))
    except (OSError, SwarmError) as error:
        sys.stderr.write(f"container: {error}\n")
        sys.exit(getattr(error, "exit_code", 1))
    for path, content in settings(name, kind, address, os.environ.get("SWARM_MONGODB_URI", "")).items():
        target = CONFIG / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(tomli_w.dumps(content), "utf-8")
    sys.stderr.write(f"container: platform {name} at {address}\n")
    sys.stderr.flush()
    os.execv(sys.executable, [sys.executable, "-m", "swarmd", "node", "--config", str(CONFIG)])


if __name__ == "__main__":
    main()
