"""Network namespaces of the nodes, each with one TAP device whose other end is the radio.

A namespace has no name: it ends with the last process in it and the last open descriptor, so nothing is left
behind by a lab that was killed. A user without capabilities has them in a user namespace (ADR 51).
"""

import ctypes
import fcntl
import os
import shutil
import socket
import struct
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from swarmware.errors import Denied

DEVICE: Final = "radio0"
ENTER: Final = ("nsenter", "--preserve-credentials")
"""Program of util-linux that starts a node in its namespaces."""
_PROBE: Final = ("unshare", "--user", "--map-current-user", "--net", "true")
"""Succeeds where users may make namespaces."""
FRAME_MAX: Final = 2048
"""Longer than an Ethernet frame of 1514 bytes."""
NETMASK: Final = "255.255.0.0"

_TUN: Final = "/dev/net/tun"
_NEW_NETWORK: Final = 0x4000_0000
_NEW_USER: Final = 0x1000_0000
"""CLONE_NEWNET and CLONE_NEWUSER of sched.h."""
_TUNSETIFF: Final = 0x4004_54CA
_IFF_TAP_NO_PI: Final = 0x0002 | 0x1000
"""Ethernet frames, without a header before them."""
_SIOCGIFFLAGS, _SIOCSIFFLAGS = 0x8913, 0x8914
_SIOCSIFADDR, _SIOCSIFNETMASK, _SIOCSIFHWADDR = 0x8916, 0x891C, 0x8924
_IFF_UP: Final = 0x1
_ARPHRD_ETHER: Final = 1
_CAPABILITIES: Final = {"CAP_NET_ADMIN": 12, "CAP_SYS_ADMIN": 21}
"""Bits of the capabilities that namespaces and devices need. Source: capabilities(7)."""


def check_rights() -> bool:
    """Whether this process has the capabilities for the namespaces, or gets them only in a user namespace.

    Raises: Denied when it can have neither, or a program or the device is missing.
    """
    missing = [f"{name} (package util-linux)" for name in (ENTER[0], _PROBE[0]) if shutil.which(name) is None]
    if not os.access(_TUN, os.R_OK | os.W_OK):
        missing.append(_TUN)
    if missing:
        raise Denied(f"--net netns: {', '.join(missing)} cannot be used; expected them, or --net loopback")
    lacking = _lacking()
    if lacking and subprocess.run(_PROBE, capture_output=True, check=False).returncode:
        raise Denied(
            f"--net netns: this process lacks {', '.join(lacking)}, and the kernel gives it no"
            " user namespace; expected root, user namespaces, or --net loopback"
        )
    return not lacking


def enter_user_namespace() -> None:
    """Moves this process, of one thread, to a user namespace in which it has all capabilities.

    Raises: Denied when the kernel refuses.
    """
    user, group = os.geteuid(), os.getegid()
    # the kernel refuses it to a process with several threads
    if _libc().unshare(_NEW_USER):
        reason = os.strerror(ctypes.get_errno())
        raise Denied(f"user namespace: {reason}; expected root, or a kernel that permits it")
    own = Path("/proc/self")
    (own / "setgroups").write_text("deny", "ascii")  # required before a user may map a group
    # the user keeps its number, so that the files of the lab still belong to it
    (own / "uid_map").write_text(f"{user} {user} 1", "ascii")
    (own / "gid_map").write_text(f"{group} {group} 1", "ascii")


def user_namespace() -> str:
    """Path by which other processes enter the user namespace of this process, while it runs."""
    return f"/proc/{os.getpid()}/ns/user"


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _lacking() -> list[str]:
    """Capabilities for namespaces and devices that this process does not have."""
    (line,) = [x for x in Path("/proc/self/status").read_text("ascii").splitlines() if x.startswith("CapEff")]
    effective = int(line.partition(":")[2], 16)
    return [name for name, bit in _CAPABILITIES.items() if not effective >> bit & 1]


class NodeNamespace:
    """A network namespace with a loopback and the TAP device of one node."""

    def __init__(self, address: str, ethernet: bytes) -> None:
        """Raises: Denied when the kernel refuses."""
        with _new_namespace() as descriptor:
            self._namespace = descriptor
            with suppress(OSError):  # read-only in some containers: IPv6 then announces itself
                Path("/proc/sys/net/ipv6/conf/default/disable_ipv6").write_text("1", "ascii")
            try:
                self._device = _open_tap()
            except OSError as error:
                raise Denied(f"{_TUN}: {error.strerror}; expected the right to make TAP devices") from error
            # any socket of this namespace serves for the ioctls of its devices
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
                hardware = struct.pack("16sH6s8x", DEVICE.encode(), _ARPHRD_ETHER, ethernet)
                fcntl.ioctl(control, _SIOCSIFHWADDR, hardware)
                fcntl.ioctl(control, _SIOCSIFADDR, _internet(address))
                fcntl.ioctl(control, _SIOCSIFNETMASK, _internet(NETMASK))
                for device in ("lo", DEVICE):
                    _bring_up(control, device)

    def fileno(self) -> int:
        """Descriptor of the device, for the event loop."""
        return self._device

    @property
    def path(self) -> str:
        """Path by which other processes enter the namespace, while this process runs."""
        return f"/proc/{os.getpid()}/fd/{self._namespace}"

    def read(self) -> bytes | None:
        """The next frame that the node sends, or None without one."""
        try:
            return os.read(self._device, FRAME_MAX)
        except BlockingIOError:
            return None

    def write(self, frame: bytes) -> bool:
        """Hands a frame to the node; False when its device is down or full."""
        try:
            os.write(self._device, frame)
        except OSError:  # the radio logs it; a frame to a full device is lost, as in the air
            return False
        return True

    def close(self) -> None:
        """Removes the device; the namespace ends with its last process."""
        os.close(self._device)
        os.close(self._namespace)


@contextmanager
def _new_namespace() -> Iterator[int]:
    """Runs its block in a new network namespace, of which it gives a descriptor."""
    before = os.open("/proc/self/ns/net", os.O_RDONLY | os.O_CLOEXEC)
    try:
        if _libc().unshare(_NEW_NETWORK):
            reason = os.strerror(ctypes.get_errno())
            raise Denied(f"network namespace: {reason}; expected root, and a container that permits it")
        yield os.open("/proc/self/ns/net", os.O_RDONLY | os.O_CLOEXEC)
    finally:
        # back to the radio's own namespace: a socket lives where it was made, and the next one is made here
        _libc().setns(before, _NEW_NETWORK)
        os.close(before)


def _open_tap() -> int:
    # non-blocking, as one process serves the devices of all nodes
    device = os.open(_TUN, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        fcntl.ioctl(device, _TUNSETIFF, struct.pack("16sH22x", DEVICE.encode(), _IFF_TAP_NO_PI))
    except OSError:
        os.close(device)
        raise
    return device


def _internet(address: str) -> bytes:
    return struct.pack("16sHH4s8x", DEVICE.encode(), socket.AF_INET, 0, socket.inet_aton(address))


def _bring_up(control: socket.socket, device: str) -> None:
    found = fcntl.ioctl(control, _SIOCGIFFLAGS, struct.pack("16sH22x", device.encode(), 0))
    flags = struct.unpack_from("16sH", found)[1]
    fcntl.ioctl(control, _SIOCSIFFLAGS, struct.pack("16sH22x", device.encode(), flags | _IFF_UP))
