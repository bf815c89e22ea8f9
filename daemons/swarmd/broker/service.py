"""The broker service: its keys, its session, its core, and the shell that runs it."""

import contextlib
import logging
import random
from typing import ClassVar

import msgspec

from swarmd.broker import config as settings
from swarmd.broker.core.admission.roster_exchange import RosterExchange
from swarmd.broker.core.beacon.beacon import PlatformCode
from swarmd.broker.core.beacon.hello_schedule import NodeIdentity
from swarmd.broker.core.boards.channel_table import ChannelTable
from swarmd.broker.core.broker import BrokerCore
from swarmd.broker.core.former_state import FormerState
from swarmd.broker.former_session import FormerSession
from swarmd.broker.links.udp import loopback_only
from swarmd.broker.membership import keys_folder
from swarmd.broker.shell import BrokerShell
from swarmware.model.clock import utc_ns
from swarmware.service.channels import load_channels
from swarmware.service.service import Service
from swarmware.transport.security.keys import Keys

log = logging.getLogger("swarm.broker")


class Broker(Service):
    """Links, neighbours, routes, channels and their counters."""

    name = "broker"
    Config: ClassVar[type[msgspec.Struct]] = settings.Config
    config: settings.Config

    async def run(self) -> None:
        """Sends beacons and forwards frames until it is cancelled.

        Raises: ConfigError when it cannot listen, Denied when the keys do not match the roster.
        """
        module = self.module
        keys = self._keys()
        former_session = FormerSession(module.node.config.data_path)
        config = loopback_only(self.config) if keys.is_open else self.config
        core = self._core(config, keys, former_session)
        shell = BrokerShell(self, config, keys, core, former_session)
        with contextlib.closing(shell):
            await shell.run()

    def _keys(self) -> Keys:
        config, folder = self.module.node.config, keys_folder(self.module.node)
        if (folder / "node.key").exists():
            return Keys.load(folder, config.platform)
        log.warning(
            "no keys in %s: only this computer is served, without authentication; "
            "make keys before the node communicates with other computers",
            folder,
        )
        return Keys.open(config.platform)

    def _core(self, config: settings.Config, keys: Keys, former_session: FormerSession) -> BrokerCore:
        node, now_ns = self.module.node, self.module.clock.now_ns()
        session = former_session.next_session(utc_ns(), keys.swarm_mark)
        quiet_ns = former_session.quiet_ns(round(config.link_timeout_s * 1e9))
        core = BrokerCore(
            NodeIdentity(
                node.hardware,
                node.platform,
                node.config.unit,
                PlatformCode[node.config.kind.upper()],
                self.module.clock.boot_id,
                keys.curve_public if keys.is_open else b"",
            ),
            config,
            session,
            connections=not keys.is_open,
            former=FormerState(former_session.declared_period_ns, quiet_ns),
            now_ns=now_ns,
            chance=random.random,
            exchange=None if keys.is_open else RosterExchange(keys, node.hardware, random.random),
            signing=None if keys.is_open else keys,
            channels=ChannelTable(load_channels(node.config_dir)),
        )
        if keys.roster is not None:
            core.add_members((member.platform for member in keys.roster.valid()), now_ns)
        return core
