"""The folder of keys of the node on this computer: its contents, and how it gets an identity."""

import os
import pwd
from pathlib import Path
from typing import Final, NamedTuple

from swarmctl.commandline.settings import CliSettings
from swarmctl.session.session import config_dir
from swarmware.errors import ConfigError, Conflict, Denied
from swarmware.model.config import DEFAULT_DIR, NodeConfig, load_node
from swarmware.runtime.filewriter import replace_file
from swarmware.transport.appfile.table import AppTable
from swarmware.transport.enrolment.joiner import Credentials
from swarmware.transport.security.keys import NODE_KEY, SEED_BYTES, Keys, read_secret, write_keys
from swarmware.transport.security.roster import parse_roster
from swarmware.transport.sodium import SigningKey

JOIN_KEY: Final = "join.key"
"""File with the seed of a pending identity, so that a repeated join asks for the same identity again."""
SERVICE_USER: Final = "swarm"
"""User of the daemons under systemd."""


class NodeKeys(NamedTuple):
    """The node on this computer, and its folder of keys."""

    config_dir: Path
    node: NodeConfig

    @classmethod
    def find(cls, settings: CliSettings) -> "NodeKeys":
        """The node that a command on this computer addresses.

        Raises: NotFound without a node, ConfigError when its node.toml is invalid.
        """
        folder = config_dir(settings)
        return cls(folder, load_node(folder))

    @property
    def platform(self) -> str:
        """Platform of the node."""
        return self.node.platform

    @property
    def folder(self) -> Path:
        """The node's folder of keys."""
        return self.config_dir / self.node.keys_dir  # an absolute path stays unchanged

    @property
    def has_identity(self) -> bool:
        """Whether the node has joined a swarm.

        Raises: Denied when this user may not read the folder.
        """
        if self.folder.exists() and not os.access(self.folder, os.R_OK | os.X_OK):
            raise Denied(f"{self.folder}: not readable by this user; expected root, or the user of the node")
        return (self.folder / NODE_KEY).exists()

    @property
    def runs(self) -> bool:
        """Whether the broker of the node runs."""
        table = AppTable(self.node.run_path)
        table.refresh(probe=True)
        return any(entry.name == "broker" for entry in table)

    def load(self) -> Keys:
        """The keys of the node. Raises: as `Keys.load`."""
        return Keys.load(self.folder, self.platform)

    def check_free(self, *, replace: bool) -> None:
        """Check that the node may get an identity.

        Raises: Conflict when it has one and `replace` is False, or when it runs; Denied when the folder
        cannot be written; ConfigError when the user that must own the folder does not exist.
        """
        if self.has_identity:
            if not replace:
                raise Conflict(
                    f"{self.folder}: {self.platform} has the keys of a swarm (`swarmctl keys show`);"
                    " expected a node without keys, or --replace to give them up"
                )
            if self.runs:
                raise Conflict(
                    f"{self.platform} runs with the keys that would be replaced; expected a stopped node"
                    " (systemctl stop swarm.target 'swarmd@*', or end of `swarmd node`)"
                )
        place = self.folder
        # the nearest existing folder decides whether the missing ones can be created
        while not place.exists():
            place = place.parent
        if not os.access(place, os.W_OK | os.X_OK):
            raise Denied(f"{place}: not writable by this user; expected root, or the user of the node")
        self._service_user()

    def pending_seed(self) -> bytes:
        """The seed of the new identity, or of an interrupted join, which continues with it.

        Raises: Denied, OSError when the folder cannot be written.
        """
        self._make_folder()
        path = self.folder / JOIN_KEY
        if path.exists() and len(seed := read_secret(path)) == SEED_BYTES:
            return seed
        seed = os.urandom(SEED_BYTES)
        replace_file(path, seed, mode=0o600)
        return seed

    def write(self, credentials: Credentials) -> None:
        """Write the identity, so that a kill leaves either no identity or a complete one.

        Raises: Denied when the roster does not have this node with this key, ConfigError, OSError.
        """
        check_member(credentials, self.platform)
        self._make_folder()
        # this file marks an identity, so it must be missing while the others change
        (self.folder / NODE_KEY).unlink(missing_ok=True)
        write_keys(self.folder, credentials.seed, credentials.root_public, credentials.roster)
        # last: until then a repeated join asks for the same identity
        (self.folder / JOIN_KEY).unlink(missing_ok=True)
        self._give_to_service_user()

    def replace_roster(self, credentials: Credentials) -> None:
        """Write a roster in which the node's key has another platform name. Raises: OSError."""
        write_keys(self.folder, credentials.seed, credentials.root_public, credentials.roster)
        self._give_to_service_user()

    def take(self, signed: bytes) -> None:
        """Write a newer roster of the root, which the node reads at its next start.

        Raises: as `Keys.apply` and `Keys.load`; OSError.
        """
        keys = self.load()
        if keys.apply(signed) is not None:
            keys.save(self.folder)
            self._give_to_service_user()

    def _make_folder(self) -> None:
        if not self.folder.exists():
            self.folder.mkdir(mode=0o700, parents=True)

    def _service_user(self) -> pwd.struct_passwd | None:
        """The daemons' user, which must own the keys of a node under systemd; None for other nodes.

        Raises: ConfigError when there is no such user.
        """
        if os.geteuid() != 0 or not self.folder.is_relative_to(DEFAULT_DIR):
            return None
        try:
            return pwd.getpwnam(SERVICE_USER)
        except KeyError as error:
            raise ConfigError(
                f"user {SERVICE_USER!r}: not known here, who is to have {self.folder}; expected it to be made"
                " at the installation (systemd-sysusers), or another keys_dir in node.toml"
            ) from error

    def _give_to_service_user(self) -> None:
        if (user := self._service_user()) is None:
            return
        for path in (self.folder, *self.folder.iterdir()):
            os.chown(path, user.pw_uid, user.pw_gid)


def check_member(credentials: Credentials, platform: str) -> None:
    """Check that the credentials belong to a member of the swarm.

    Raises: Denied when the roster does not have the platform with this key, ConfigError when it is damaged.
    """
    roster = parse_roster(credentials.roster, credentials.root_public, "the roster of the invitation")
    member = roster.find(platform)
    if member is None or member.sign_public != SigningKey(credentials.seed).public:
        raise Denied(
            f"the roster of the invitation does not have {platform} with its new key; expected it to"
        )
