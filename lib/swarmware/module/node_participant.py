"""One application on its node: its identity, and its declarations in the application file."""

import asyncio
import logging
from collections.abc import Mapping
from typing import Final, Literal

import msgspec

from swarmware.errors import Conflict, Denied, InvalidInput
from swarmware.model import names
from swarmware.model.paths import is_reserved_path
from swarmware.model.resource import Kind, Plain, Resource, clash_text
from swarmware.module.remote_clocks import RemoteClocks
from swarmware.module.unit_directory import UnitDirectory
from swarmware.node.node import Node
from swarmware.transport.appfile.entry import AppEntry, Served
from swarmware.transport.appfile.file import AppFile
from swarmware.types import registry

log = logging.getLogger("swarm.module")

_EVERYWHERE: Final = "swarmware.types."
"""Package of the types that every node has."""


class NodeParticipant:
    """Represents the application on the node from its construction until `close`.

    Declarations are written together, in the next iteration of the event loop.
    Raises: Conflict when the instance runs already.
    """

    def __init__(
        self,
        name: str,
        node: Node,
        *,
        instance: int | None = None,
        config: msgspec.Struct | None = None,
        live_settings: Mapping[str, str] | None = None,
    ) -> None:
        self.name = name
        self.node = node
        self._file = AppFile(
            node.run_dir,
            name,
            endpoint=node.messaging.address,
            started_ns=node.clock.now_ns(),
            instance=instance,
            config=msgspec.to_builtins(config) if config is not None else None,
            live=live_settings,
            announce=node.announce_apps,
        )
        # an operator may delete the run directory while the node runs
        node.keep_file(self._file.tend)
        self.remote_clocks = RemoteClocks(node)
        self.units = UnitDirectory(node)
        self._provides: dict[str, Resource] = {}
        self._numbers: dict[int, Resource] = {}
        """Provided resources by their numbers in frames."""
        self._table_version = -1
        self._on_node: dict[int, Resource] = {}
        self._serves: dict[str, Served] = {}
        self._reads: dict[str, float | None] = {}
        self._types: dict[str, str] = {}
        self._applied: dict[str, Plain] = {}
        self._flush_comes = False
        node.messaging.add_application(self.app_id)
        node.messaging.add_clocks(self.remote_clocks)

    @property
    def entry(self) -> AppEntry:
        """Content of the application file."""
        return self._file.entry

    @property
    def app_id(self) -> int:
        """Application id, the sender of its frames."""
        return self.entry.app_id

    @property
    def id(self) -> str:
        """Name and instance of the application: `name#instance`."""
        return f"{self.name}#{self.entry.instance}"

    def local(self, path: str) -> str:
        """A path of this platform in its local form; of another, unchanged.

        Raises: InvalidInput.
        """
        platform, local = names.split(names.check_path(path))
        return local if platform in {self.node.platform, self.node.address.path} else path

    def own(self, path: str) -> str:
        """The local form of a path of this platform.

        Raises: InvalidInput for a path of another platform.
        """
        local = self.local(path)
        if local.startswith("/"):
            raise InvalidInput(f"{path}: of another platform; expected a resource of {self.node.platform}")
        return local

    # -- declarations

    def provide(self, resource: Resource) -> None:
        """Declare a resource of this application in its file, from which the tree reads it.

        Raises: Conflict when another path has the same number in frames.
        """
        self.check_number(resource)
        if resource.owner != self.name:
            resource = msgspec.structs.replace(resource, owner=self.name)
        self._provides[resource.path] = resource
        self._numbers[resource.data_id] = resource
        self._changed()

    def declare(self, cls: type[msgspec.Struct]) -> None:
        """Describe a payload type of this application, for nodes without a module that defines it."""
        name = registry.type_name(cls)
        # types of the library are known on each node of the same version
        if name in self._types or (cls.__module__.startswith(_EVERYWHERE) and registry.known(cls)):
            return
        from swarmware.types.description import (
            describe,
        )  # only types of one's own need it

        try:
            self._types[name] = msgspec.json.encode(describe(cls)).decode()
        except (NameError, TypeError, ValueError) as error:  # an annotation that cannot be resolved
            log.warning("type %s: no description for others: %s", name, error)
            return
        self._changed()

    def withdraw(self, path: str) -> None:
        """Withdraw the declaration of a resource."""
        if (resource := self._provides.pop(path, None)) is not None:
            self._numbers.pop(resource.data_id, None)
            self._changed()

    def read(self, path: str, within_s: float | None = None) -> None:
        """Declare that a resource is read here, so that this node subscribes to it where it is provided.

        `within_s`: longest delay with which it is of use, or None if not stated.
        """
        self._reads[path] = within_s
        self._changed()

    def apply(self, settings: Mapping[str, Plain]) -> None:
        """Declare values of live settings that this application has taken, by the key of the setting."""
        self._applied.update(settings)
        self._changed()

    def serve(
        self,
        path: str,
        cls: type[msgspec.Struct],
        kind: Literal["message", "request", "datagram"],
        *,
        reply: str = "",
        description: str = "",
    ) -> Served:
        """Declare that this application serves an address of this platform.

        Raises: Conflict when another application has it, or another path its number in frames;
        Denied when it is one of the daemons' addresses, and this process runs as another user than the node.
        """
        if is_reserved_path(path) and self._file.is_foreign:
            raise Denied(
                f"{path}: served by the user of the node alone; expected a path outside sys/ and cmd/"
            )
        table = self.node.table
        table.refresh()
        other = table.serving_path(path)
        if other is not None and other[0].id != self.id:
            table.refresh(probe=True)  # the other application may have died
            other = table.serving_path(path)
        if other is not None and other[0].id != self.id:
            raise Conflict(f"{path}: served by {other[0].id} already; expected one application only")
        served = Served(path=path, type=registry.type_name(cls), kind=kind)
        self.provide(
            Resource(
                path=path,
                kind=Kind.COMMAND,
                type=served.type,
                reply=reply,
                description=description,
                access="rw",
            )
        )
        self.declare(cls)
        self._serves[path] = served
        return served

    def check_number(self, resource: Resource) -> None:
        """Check that no path of this node has the number of the resource in frames.

        Raises: Conflict naming both paths.
        """
        number = resource.data_id
        other = self._numbers.get(number) or self._others().get(number)
        if other is not None and (other.path, other.type) != (resource.path, resource.type):
            raise Conflict(clash_text(resource.path, other))

    def _others(self) -> dict[int, Resource]:
        """Resources of the applications of this node, by number.

        A program of another user than the node's keeps no application of the node from its paths.
        """
        table = self.node.table
        if self._table_version != table.version:
            self._table_version = table.version
            # a foreign program yields to everything; the node's own yield to each other only
            counted = table if self._file.is_foreign else table.of_node
            self._on_node = {one.data_id: one for entry in counted for one in entry.provides}
        return self._on_node

    def _changed(self) -> None:
        if not self._flush_comes:
            self._flush_comes = True
            # a module declares a dozen resources at its start: one file, one bell
            asyncio.get_running_loop().call_soon(self._flush)

    def _flush(self) -> None:
        self._flush_comes = False
        # the module has left between the call and this turn of the loop
        if self._file.closed:
            return
        self._file.write(
            msgspec.structs.replace(
                self._file.entry,
                provides=tuple(self._provides.values()),
                serves=tuple(self._serves.values()),
                reads=tuple(self._reads),
                needs={path: need_s for path, need_s in self._reads.items() if need_s is not None},
                types=self._types,
                applied=dict(self._applied),
            )
        )

    def close(self) -> None:
        """Leave the node and remove the application file."""
        messaging = self.node.messaging
        messaging.remove_clocks(self.remote_clocks)
        self.remote_clocks.close()
        self.units.close()
        messaging.remove_application(self.app_id)
        self.node.release_file(self._file.tend)
        self._file.close()
