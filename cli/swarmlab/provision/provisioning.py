"""Folders, configuration and keys of a lab: made before its first process starts, removed after its last."""

import hashlib
import os
import random
import shutil
import socket
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.session import labs, processes
from swarmctl.session.labs import LabNode, LabState
from swarmlab.provision import plan
from swarmlab.provision.database import server_of
from swarmlab.provision.node_files import AIRFIELD, OF_UNIT, VEHICLE, write_node
from swarmlab.provision.plan import PlannedNode
from swarmlab.radio.files import find_radio, load_radio
from swarmlab.radio.namespace import check_rights
from swarmware.errors import Conflict, InvalidInput, NoAnswer
from swarmware.model.airframe_file import load_airframe
from swarmware.model.config import share_dir
from swarmware.model.names import MAIN, Address
from swarmware.model.platform_kind import PlatformKind
from swarmware.transport.security.root import make_swarm

SHM: Final = Path("/dev/shm")
LOOPBACK: Final = "127.0.0.1"
RADIO_NETWORK: Final = "10.83"
"""First two bytes of the addresses of nodes in network namespaces."""
PORTS: Final = range(20_000, 32_000)
"""Below the ephemeral ports of the kernel (32768 and up)."""
NETWORK_NAMESPACES: Final = "netns"
NETS: Final = ("loopback", NETWORK_NAMESPACES)
RADIO: Final = "s3"
"""Radio between the nodes, unless another one is named."""
CLAIM_TRIES: Final = 99
ENDING: Final = "ending"
"""File in the lab's folder: its end has begun."""


class LabSpec(msgspec.Struct, frozen=True, kw_only=True):
    """Specification of a lab."""

    experiment: str
    nodes: int
    seed: int
    usv: int = 0
    """Number of surface vessels among the nodes."""
    name: str = ""
    """Name of the lab, or "" for the experiment's name, with a number when that is taken."""
    net: str = "loopback"
    radio: str = ""
    """Name or path of a radio file, or "" for the default of the network."""
    per_daemon: str | None = None
    """Nodes with a process per daemon, `all` or names; None for one process per node."""
    units: str | None = None
    """Vehicles with three computers, `all` or names; None for one computer per vehicle."""
    unit_delay_ms: tuple[float, ...] = ()
    """Shortest and longest simulated delay between the computers of a vehicle."""
    airframe: tuple[str, ...] = ()
    """Airframes of air vehicles: `helicopter` for all, `uav1,uav2=fixed_wing` for those."""
    mongodb_uri: str = ""
    services: tuple[str, ...] = ()
    """Services of every node beside the usual ones."""


def make(spec: LabSpec) -> LabState:
    """Makes the lab's folders, configuration and keys.

    Raises: InvalidInput for a specification that cannot be met, Conflict when the name is taken.
    """
    if spec.net not in NETS:
        raise InvalidInput(f"--net {spec.net}: unknown; expected one of {', '.join(NETS)}")
    radio_file = _radio_file(spec)
    # all options are checked before the folder is claimed, so that a refusal leaves nothing behind
    as_user = spec.net == NETWORK_NAMESPACES and not check_rights()
    who = plan.members(spec.nodes, spec.seed, spec.usv)
    separate = plan.per_daemon(spec.per_daemon, who)
    distributed = plan.distributed(spec.units, who)
    airframes = plan.airframes(spec.airframe, who)
    models = {name: load_airframe(share_dir(), name) for name in set(airframes.values())}
    extra = plan.extra_services(spec.services, {*VEHICLE, *OF_UNIT["nav"], *OF_UNIT["fc"]})
    circles = any(model.type == "fixed_wing" for model in models.values())
    folder = _claim(spec)
    try:
        nodes = [
            _node(folder, member, unit, member.platform in separate, spec.seed)
            for member in who
            for unit in (plan.UNITS if member.platform in distributed else (MAIN,))
        ]
        # both at random, so that labs of several users or computers do not receive each other
        group, port = _group(), _free_port()
        if spec.net == NETWORK_NAMESPACES:
            nodes = [_behind_radio(node, index, as_user=as_user) for index, node in enumerate(nodes)]
        lab = LabState(
            name=folder.name,
            experiment=spec.experiment,
            net=spec.net,
            seed=spec.seed,
            folder=str(folder),
            created_utc_ns=time.time_ns(),
            starter=processes.identity(os.getpid()),
            multicast_group=group,
            udp_port=port,
            radio_file=radio_file,
            mongodb_uri=spec.mongodb_uri,
            mongodb_database=f"swarm_{folder.name}" if spec.mongodb_uri else "",
            nodes=tuple(nodes),
            unit_delay_ms=spec.unit_delay_ms,
            world=AIRFIELD if circles else "",
            airframes=airframes,
            services=extra,
        )
        labs.save(lab)
        keys = folder / "keys"
        roles = {m.platform: "maintainer" if m.kind == PlatformKind.GCS else "node" for m in who}
        make_swarm(keys, roles, lab.name)
        for node in lab.nodes:
            write_node(lab, node, keys)
        # each node has its copy; the folder of all would let any process of the lab act as any node
        shutil.rmtree(keys)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return lab


def remove(lab: LabState, *, keep: bool = False) -> None:
    """Removes the files of the lab: shared memory and sockets; with `keep` not configuration and logs."""
    for node in lab.nodes:
        shutil.rmtree(node.shm_dir, ignore_errors=True)
        shutil.rmtree(node.run_dir, ignore_errors=True)
        with suppress(FileNotFoundError):
            node.notify_path.unlink()
    if not keep:
        shutil.rmtree(lab.folder, ignore_errors=True)


def is_ending(lab: LabState) -> bool:
    """Whether the end of this lab has begun: its nodes are not restarted any more."""
    return (Path(lab.folder) / ENDING).exists() or not Path(lab.folder).exists()


def down(lab: LabState, *, keep: bool = False) -> int:
    """Ends all processes of the lab and removes its files; returns how many had to be killed.

    Raises: NoAnswer when a process cannot be ended.
    """
    with suppress(FileNotFoundError):
        # before the first signal: the process that started the lab must not restart a killed node
        (Path(lab.folder) / ENDING).touch()
    forced = processes.end([node.identity for node in lab.nodes if node.pid], lab.mark)
    if left := processes.marked(lab.mark):
        pids = ", ".join(str(process.pid) for process in left)
        raise NoAnswer(f"lab {lab.name}: processes {pids} do not end after SIGKILL; expected their end")
    remove(lab, keep=keep)
    return forced


def _claim(spec: LabSpec) -> Path:
    folder = labs.labs_folder()
    if spec.name:
        names = [labs.check_name(spec.name)]
    else:
        names = [spec.experiment, *(f"{spec.experiment}{i}" for i in range(2, CLAIM_TRIES))]
    for name in names:
        _remove_dead_lab(folder / name)
        with suppress(FileExistsError):
            # atomic: of two commands at a time only one gets the name
            (folder / name).mkdir(mode=0o700)
            return folder / name
    raise Conflict(f"lab {names[0]!r}: exists already; expected another --name, or `swarmctl lab down`")


def _remove_dead_lab(folder: Path) -> None:
    """Ends and removes a lab without a running node; its name becomes free."""
    if not (folder / labs.FILE).exists():
        return
    lab = labs.load(folder)
    starting = lab.starter.alive() and not all(node.pid for node in lab.nodes)
    if not (lab.running or starting):
        down(lab)  # its radio may still run


def _radio_file(spec: LabSpec) -> str:
    """Path of the checked radio file, or "" if the nodes are connected without a radio.

    Raises: InvalidInput when options contradict each other; as `find_radio`, `load_radio`, `server_of`.
    """
    if spec.net == "loopback":
        if spec.radio:
            raise InvalidInput(f"--radio {spec.radio}: --net loopback has no radio; expected --net netns")
        return ""
    if spec.mongodb_uri:
        server_of(spec.mongodb_uri)
    path = find_radio(spec.radio or RADIO)
    load_radio(path)
    return str(path)


def _behind_radio(node: LabNode, index: int, *, as_user: bool) -> LabNode:
    """The node in a network namespace of its own; `as_user`: in a user namespace as well."""
    folder = Path(node.folder)
    return msgspec.structs.replace(
        node,
        address=f"{RADIO_NETWORK}.{(index + 1) >> 8}.{(index + 1) & 255}",
        namespace=str(folder / "netns"),
        user_namespace=str(folder / "userns") if as_user else "",
    )


def _node(folder: Path, member: PlannedNode, unit: str, separate: bool, seed: int) -> LabNode:
    name = str(Address(member.platform, unit))
    offset_s, drift_ppm = plan.clock_of(member, unit, seed)
    return LabNode(
        platform=name,
        kind=member.kind,
        folder=str(folder / "n" / name),
        shm_dir=str(SHM / f"swarm-{os.getuid()}-{_alias(folder)}-{name}"),
        processes="per-daemon" if separate else "one",
        offset_s=offset_s,
        drift_ppm=drift_ppm,
    )


def _alias(folder: Path) -> str:
    """Unique name of the lab: outside the default folder of labs another lab may have the same name."""
    if folder.parent == labs.default_folder():
        return folder.name
    where = hashlib.blake2b(os.fsencode(folder.parent.resolve()), digest_size=4)
    return f"{folder.name}-{where.hexdigest()}"


def _group() -> str:
    """A random multicast group of the site-local scope (RFC 2365)."""
    chance = random.SystemRandom()
    return f"239.255.{chance.randrange(1, 255)}.{chance.randrange(1, 255)}"


def _free_port() -> int:
    """A UDP port that is not in use now."""
    chance = random.SystemRandom()
    for _ in range(CLAIM_TRIES):
        port = chance.choice(PORTS)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, suppress(OSError):
            # a port that is in use: the next one is tried
            probe.bind(("", port))
            return port
    raise Conflict(f"UDP ports {PORTS.start}..{PORTS.stop}: none free; expected one")
