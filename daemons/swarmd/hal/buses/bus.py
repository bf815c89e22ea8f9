"""The interface of all buses: a connection to one device, and the errors that a bus reports."""

import errno
import os
from abc import ABC, abstractmethod
from typing import Final

from swarmd.hal.driver import DeviceError, DeviceGone

_ABSENT: Final = frozenset({errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.ENOTDIR})
_FORBIDDEN: Final = frozenset({errno.EACCES, errno.EPERM})
_SILENT: Final = frozenset({errno.EREMOTEIO, errno.ETIMEDOUT, errno.EAGAIN, errno.ENXIO})
"""Errors of I2C adapters when no device acknowledges. Source: Linux, Documentation/i2c/fault-codes."""
_UNSUPPORTED: Final = frozenset({errno.ENOTTY, errno.EOPNOTSUPP, errno.EINVAL})


class Bus(ABC):
    """Base of connections to one device, opened by the constructor and used by one driver.

    Each method raises DeviceGone when the device is absent, DeviceError when it does not answer.
    """

    path: str
    """Device file, folder or interface of the bus, for error messages."""

    @abstractmethod
    def close(self) -> None:
        """Closes the connection to the device."""


class DeviceFile:
    """A device file of the kernel, open for reading and writing until it is closed.

    Raises: DeviceGone when the file is missing; DeviceError without access.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        try:
            self.fd = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except OSError as error:
            raise opening_error(path, error) from error

    def close(self) -> None:
        """Closes the file; further calls do nothing."""
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1


def opening_error(path: str, error: OSError) -> DeviceError:
    """Error of a bus that could not be opened."""
    if error.errno in _ABSENT:
        return DeviceGone(f"{path}: no such device")
    # the most frequent mistake of an installation gets its remedy in the message
    if error.errno in _FORBIDDEN:
        return DeviceError(
            f"{path}: permission denied; expected read and write access for the user of the daemon"
        )
    return DeviceError(f"{path}: {error.strerror}")


def transfer_error(path: str, error: OSError) -> DeviceError:
    """Error of a failed transfer on an open bus."""
    # before the others: ENXIO means absent at the opening, but silent in a transfer
    if error.errno in _SILENT:
        return DeviceError(f"{path}: the device does not answer ({error.strerror})")
    if error.errno == errno.ENODEV:
        return DeviceGone(f"{path}: unplugged: {error.strerror}")
    if error.errno in _UNSUPPORTED:
        return DeviceError(f"{path}: not a bus of this kind, or without this function: {error.strerror}")
    return DeviceError(f"{path}: {error.strerror}")
