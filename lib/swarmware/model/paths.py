"""Paths of a node's files and sockets, resource paths that are derived from a name, and reserved names.

`share/doc/protocol.md` defines them for other implementations.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from swarmware.model.names import segment

APPLICATION_PATTERN: Final = "*.toml"
SOCKET_PATTERN: Final = "*.sock"
APPLICATIONS: Final = frozenset(
    {
        "broker",
        "control",
        "estimator",
        "files",
        "guard",
        "guidance",
        "hal",
        "health",
        "lidar",
        "logger",
        "mission",
        "navigator",
        "register",
        "sim",
        "timesync",
        "tree",
        "video",
    }
)
"""Names of the daemons, which no program of another user has. A test compares them with those installed."""
BRANCHES: Final = ("sys/", "cmd/")
"""Branches below which the daemons serve messages and requests. A test compares them with running daemons."""


def applications(run_dir: Path) -> Path:
    """Folder of the application files."""
    return run_dir / "apps"


def application_file(name: str, instance: int) -> str:
    """File name of an instance of an application, in the folder of the application files."""
    return f"{name}#{instance}.toml"


def platform_settings(folder: Path, platform: str) -> Path:
    """File of the live settings of a platform, in a folder for several platforms."""
    return folder / f"{platform}.toml"


def sockets(run_dir: Path) -> Path:
    """Folder of the sockets of all processes."""
    return run_dir / "p"


def socket(run_dir: Path, doorbell: str) -> Path:
    """Socket of the process with this doorbell."""
    return sockets(run_dir) / f"{doorbell}.sock"


def sockets_of(run_dir: Path, pid: int) -> list[Path]:
    """Sockets of the process with this pid, which may have ended."""
    return list(sockets(run_dir).glob(f"{pid}-*.sock"))


def doorbells(run_dir: Path) -> Path:
    """Folder of the doorbells of all processes."""
    return run_dir / "bells"


def applications_watchers(shm_dir: Path) -> Path:
    """Doorbells that are rung when applications join, leave or change."""
    return shm_dir / "apps.readers"


def mirrors_watchers(shm_dir: Path) -> Path:
    """Doorbells that are rung when a mirror of another platform's resource appears."""
    return shm_dir / "mirrors.readers"


def master_watchers(shm_dir: Path) -> Path:
    """Doorbells of all processes, which are rung when the master changes."""
    return shm_dir / "master.readers"


def shared_memory(platform: str) -> Path:
    """Folder of a platform's shared memory, unless it is configured."""
    return Path(f"/dev/shm/swarm-{platform}")


def service_config(config_dir: Path, name: str) -> Path:
    """Configuration file of a service."""
    return config_dir / "services" / f"{name}.toml"


def world(share_dir: Path, name: str) -> Path:
    """File of a simulated world."""
    return share_dir / "worlds" / f"{name}.toml"


def airframe(share_dir: Path, name: str) -> Path:
    """File of an airframe."""
    return share_dir / "airframes" / f"{name}.toml"


def imu_calibration(data_dir: Path) -> Path:
    """File with the corrections of the inertial units, by driver."""
    return data_dir / "imu-calibration.json"


def drain_record(data_dir: Path) -> Path:
    """File that states who drained the platform, and is missing unless it is drained."""
    return data_dir / "drained.json"


def log(data_dir: Path) -> Path:
    """Folder of the local log."""
    return data_dir / "log"


def missions(data_dir: Path) -> Path:
    """Folder of the missions that are stored on a node, and of the runs that it has played."""
    return data_dir / "missions"


def status(application: str) -> str:
    """Resource path at which a service reports its state and its heartbeat."""
    return f"app/{segment(application)}/status"


def tree_request(verb: str) -> str:
    """Resource path of a request to a tree: get, set, undo, structure and others."""
    return f"sys/tree/{verb}"


def setting(key: str) -> str:
    """Resource path of a live setting: of `navigator/speed_m_s`."""
    return f"config/{key}"


def history(board: str) -> str:
    """Path of the mirror with former values of another platform's board, which arrived late."""
    return f"sys/history/{board}"


def simulated_sensor(device: str) -> str:
    """Resource path at which the simulation writes the measurements of a sensor."""
    return f"sim/sensors/{device}"


SIM_SETPOINT: Final = "sim/chassis/setpoint"
SIM_OUTPUTS: Final = "sim/chassis/outputs"
SIM_ORDERS: Final = "sim/chassis/orders"
SIM_REPORT: Final = "sim/chassis/report"
"""Resources of the simulated chassis: what it gets from its driver, and what it reports."""


def checks(application: str, instance: int) -> str:
    """Resource path of the checks that an application runs itself."""
    suffix = "" if instance == 1 else f"_{instance}"
    return f"health/checks/{segment(application)}{suffix}"


def is_reserved_path(local: str) -> bool:
    """Whether only the user of the node may serve this local path.

    Orders to a vehicle go to such paths. A member of the node's group may run programs on the node, and would
    otherwise answer the orders of all users.
    """
    return local.startswith(BRANCHES)
