"""The installed package from which a host is set up: its programs, units and pristine configuration."""

import sys
from pathlib import Path
from typing import Final, NamedTuple

from swarmware.errors import InvalidInput
from swarmware.model.config import share_dir

HIDDEN: Final = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")
"""Folders that the units hide from the daemons (ProtectHome, PrivateTmp)."""
PROGRAMS: Final = ("swarmd", "swarmctl")


class InstalledPackage(NamedTuple):
    """Folders of the package that runs."""

    programs: Path
    """Folder of `swarmd` and `swarmctl`."""
    share: Path
    """Folder of units and templates."""

    @classmethod
    def find(cls) -> "InstalledPackage":
        """The package of this process. Raises: ConfigError without its share folder."""
        return cls(Path(sys.prefix) / "bin", share_dir())

    @property
    def configuration(self) -> Path:
        """Folder of the configuration files as they are shipped."""
        installed = self.share / "etc"
        return installed if installed.is_dir() else self.share.parents[1] / "etc" / "swarm"  # a checkout

    @property
    def units(self) -> Path:
        """Folder of the units, and of the files for other programs of systemd."""
        return self.share / "systemd"

    def check_visible(self) -> None:
        """Check that the daemons can run the programs.

        Raises: InvalidInput for a folder that their user or their units cannot read.
        """
        for folder in (self.programs, self.share):
            resolved = folder.resolve()
            if any(resolved.is_relative_to(hidden) for hidden in HIDDEN):
                raise InvalidInput(
                    f"{folder}: the daemons cannot read it, because their units hide {', '.join(HIDDEN)};"
                    " expected an environment elsewhere, such as /opt/swarm"
                )
            # one closed parent is enough to hide the programs from the daemons' user
            closed = next(
                (one for one in (resolved, *resolved.parents) if not one.stat().st_mode & 0o001), None
            )
            if closed is not None:
                raise InvalidInput(
                    f"{closed}: closed to the user of the daemons; expected mode 0755 (umask 022 at the"
                    " installation)"
                )
