"""Hot-plugging: watches the folders of device files, and reads the kernel's data about the devices."""

import asyncio
import ctypes
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final

import msgspec

from swarmd.hal.config import Config, RecognitionRule
from swarmd.hal.core.recognition import DeviceNode, Recognised
from swarmware.errors import SwarmError
from swarmware.model.config import convert

SYS: Final = Path("/sys")
_CREATED: Final = 0x100
_MOVED_TO: Final = 0x80
_ATTRIBUTES: Final = 0x4
"""IN_CREATE, IN_MOVED_TO, and IN_ATTRIB as udev grants access after the creation. Source: inotify(7)."""
_ADD: Final = 0x20000000
"""IN_MASK_ADD, because a watched folder may also be the parent of another watched folder."""
_EVENT_BYTES: Final = 4096


def nodes(patterns: Iterable[str], sys: Path = SYS) -> Iterator[DeviceNode]:
    """Device files that match patterns such as `/dev/ttyUSB*`."""
    for pattern in patterns:
        folder, _, name = pattern.rpartition("/")
        for path in Path(folder or "/").glob(name):
            # the kernel knows only the target of a link such as /dev/serial/by-id/…
            yield DeviceNode(str(path), usb_id(path.resolve().name, sys))


def usb_id(name: str, sys: Path = SYS) -> str:
    """Vendor and product of the USB device of a device file, or "" for a device that is not on USB."""
    for link in sys.glob(f"class/*/{name}/device"):
        place = link.resolve()
        for folder in (place, *place.parents):
            try:
                vendor = (folder / "idVendor").read_text("ascii").strip()
                return f"{vendor}:{(folder / 'idProduct').read_text('ascii').strip()}".lower()
            except (OSError, UnicodeDecodeError):
                continue  # a USB interface or hub port, whose parent may be the device
    return ""


def configured(config: Config, one: Recognised[RecognitionRule]) -> Config:
    """Configuration in which the driver of a rule has the recognised device and the rule's settings."""
    given = {"device": one.node.path, **one.rule.settings}
    name = one.rule.driver
    if name in Config.__struct_fields__:
        table = msgspec.to_builtins(getattr(config, name))
        settings = msgspec.to_builtins(config) | {name: table | given}
    else:
        plugins = {**config.plugins, name: {**config.plugins.get(name, {}), **given}}
        settings = msgspec.to_builtins(config) | {"plugins": plugins}
    return convert(settings, Config, f"services/hal.toml: rule for {one.rule.path}")


class FolderWatch:
    """Calls a function when files appear in folders, or their access rights change.

    The folders may be created later, and again. Raises: SwarmError when the kernel refuses the watch.
    """

    def __init__(self, folders: Iterable[str], changed: Callable[[], None]) -> None:
        libc = ctypes.CDLL(None, use_errno=True)
        self._changed = changed
        self._fd: int = libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
        if self._fd < 0:
            raise SwarmError(f"inotify: {os.strerror(ctypes.get_errno())}")
        self._add_watch: Callable[[int, bytes, int], int] = libc.inotify_add_watch
        self._folders = sorted(set(folders))
        self._watch()
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._fd, self._readable)

    def _watch(self) -> None:
        """Watches the existing folders and their parents.

        Repeated after each event, because a folder may have been created again; the kernel ignores a repeated
        watch of the same folder.
        """
        for folder in self._folders:
            self._add_watch(self._fd, os.fsencode(folder), _CREATED | _MOVED_TO | _ATTRIBUTES | _ADD)
            # parents are watched too, since the folder may appear with its first device
            for above in Path(folder).parents[:-1]:
                self._add_watch(self._fd, os.fsencode(above), _CREATED | _MOVED_TO | _ADD)

    def _readable(self) -> None:
        try:
            os.read(self._fd, _EVENT_BYTES)
        except BlockingIOError:
            return
        self._watch()
        self._changed()

    def close(self) -> None:
        """Ends the watch of all folders."""
        self._loop.remove_reader(self._fd)
        os.close(self._fd)
