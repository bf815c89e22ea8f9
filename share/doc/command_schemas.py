"""The type of each command's structured result, and its JSON Schema."""

from collections.abc import Iterator
from importlib import import_module
from typing import Any, Final

import msgspec

from swarmctl.terminal.output import SCHEMA_VERSION
from swarmware.types.json_form import json_schema

DOCUMENTS: Final = {
    "node ls": "swarmctl.commands.node.overview:NodeList",
    "node ls UNITS": "swarmctl.commands.node.units:UnitList",
    "node info": "swarmctl.commands.node.identity:ShownNode",
    "node drain": "swarmctl.commands.node.draining:NodeDrained",
    "node undrain": "swarmctl.commands.node.draining:NodeDrained",
    "host install": "swarmctl.commands.host.installing:HostChanged",
    "host uninstall": "swarmctl.commands.host.installing:HostChanged",
    "node add": "swarmctl.membership.inviting:InvitedNode",
    "node remove": "swarmctl.commands.node.removing:NodesRemoved",
    "node rename": "swarmctl.commands.node.renaming:NodeRenamed",
    "keys init": "swarmctl.commands.keys.making:MadeSwarm",
    "keys invite": "swarmctl.membership.inviting:InvitedNode",
    "keys join": "swarmctl.membership.joining:JoinedSwarm",
    "keys ls": "swarmctl.commands.keys.listing:MemberList",
    "keys show": "swarmctl.commands.keys.listing:MemberList",
    "keys revoke": "swarmctl.membership.changing:RosterChanged",
    "keys rotate": "swarmctl.membership.changing:RosterChanged",
    "node restart": "swarmctl.resources.restart:RestartedServices",
    "app restart": "swarmctl.resources.restart:RestartedServices",
    "app start": "swarmctl.commands.app.stopping:ServicesChanged",
    "app stop": "swarmctl.commands.app.stopping:ServicesChanged",
    "app ls": "swarmctl.commands.app.listing:ApplicationList",
    "tree ls": "swarmware.types.tree:TreeListing",
    "tree show": "swarmware.types.tree:TreeListing",
    "tree get": "swarmctl.resources.access:ResourceReading",
    "tree get PATTERN": "swarmctl.resources.access:Readings",
    "tree set": "swarmctl.resources.access:WriteResult",
    "tree undo": "swarmctl.resources.undoing:SettingUndone",
    "tree log": "swarmctl.commands.tree.change_log:ChangeRecord",
    "tree dump": "swarmctl.commands.tree.snapshot:TreeSnapshot",
    "tree load": "swarmctl.commands.tree.snapshot:ValuesLoaded",
    "tree diff": "swarmctl.commands.tree.comparison:TreeDiff",
    "tree lint": "swarmctl.commands.tree.lint:TreeLint",
    "tree rule": "swarmware.types.tree:TreeRules",
    "tree watch": "swarmctl.commands.tree.watching:WatchedValue",
    "tree type": "swarmctl.commands.tree.types:ShownTypes",
    "tree hz": "swarmctl.commands.tree.measuring:MeasuredRates",
    "tree bw": "swarmctl.commands.tree.measuring:MeasuredBandwidths",
    "tree delay": "swarmctl.commands.tree.measuring:MeasuredDelays",
    "call": "swarmctl.commands.call.request:CallAnswer",
    "pub": "swarmctl.commands.pub.publishing:PublishedValues",
    "wait": "swarmctl.commands.wait.waiting:ConditionReached",
    "topo": "swarmctl.commands.topo.topology:SwarmTopology",
    "link ls": "swarmware.types.net:Neighbours",
    "link outages": "swarmware.types.outage:OutageTable",
    "traffic ls": "swarmware.types.traffic:Traffic",
    "traffic channels": "swarmctl.commands.traffic.channels:ChannelsView",
    "traffic clear": "swarmware.types.channel:ChannelLimits",
    "traffic needs": "swarmctl.commands.traffic.needs:LinkNeeds",
    "traffic set": "swarmware.types.channel:ChannelLimits",
    "traffic undo": "swarmware.types.channel:ChannelLimits",
    "traffic top": "swarmctl.commands.traffic.rates:TrafficRates",
    "video start": "swarmware.types.video:VideoSession",
    "video ls": "swarmware.types.video:VideoSessions",
    "video rate": "swarmware.types.video:VideoSession",
    "video stop": "swarmware.types.video:VideoSessions",
    "mission ls": "swarmware.types.mission:MissionList",
    "mission import": "swarmctl.commands.mission.plan_import:ImportedPlan",
    "mission check": "swarmctl.commands.mission.task:MissionVerdicts",
    "mission start": "swarmware.types.mission:TaskAnswer",
    "mission status": "swarmware.types.mission:MissionStatus",
    "mission queue": "swarmware.types.mission:MissionQueue",
    "mission answer": "swarmctl.commands.mission.answering:MissionAnswer",
    "mission history": "swarmware.types.mission_run:MissionHistory",
    "mission history ID": "swarmware.types.mission_run:RunDetails",
    "mission cancel": "swarmware.types.mission:AbortAnswer",
    "mission prioritize": "swarmware.types.mission:AbortAnswer",
    "mission watch": "swarmctl.commands.mission.members:MemberState",
    "mission abort": "swarmctl.commands.mission.abort:MissionAborted",
    "takeoff": "swarmctl.vehicles.observer:CommandResult",
    "goto": "swarmctl.vehicles.observer:CommandResult",
    "drive": "swarmctl.commands.drive.stick:HandDriven",
    "hold": "swarmctl.vehicles.observer:CommandResult",
    "land": "swarmctl.vehicles.observer:CommandResult",
    "return": "swarmctl.vehicles.observer:CommandResult",
    "arm": "swarmctl.vehicles.observer:CommandResult",
    "disarm": "swarmctl.vehicles.observer:CommandResult",
    "kill": "swarmctl.vehicles.observer:CommandResult",
    "hal ls": "swarmctl.commands.hal.drivers:DriverList",
    "hal calibrate": "swarmctl.commands.hal.calibration:CalibrationStarted",
    "time ls": "swarmware.types.time:TimeFunctions",
    "health ls": "swarmctl.commands.health.report:HealthStates",
    "health ready": "swarmctl.commands.health.readiness:ReadinessList",
    "health info": "swarmware.types.health:HealthReport",
    "health faults": "swarmware.types.health:FaultList",
    "health clear": "swarmware.types.health:FaultList",
    "log query": "swarmctl.commands.log.entries:PrintedEntry",
    "log tail": "swarmctl.commands.log.entries:PrintedEntry",
    "log stats": "swarmctl.commands.log.entries:LogStatistics",
    "lab up": "swarmlab.run.listing:LabLine",
    "lab ls": "swarmlab.run.listing:LabList",
    "lab env": "swarmlab.run.listing:LabEnvironment",
    "lab down": "swarmlab.run.lifecycle:EndedLabs",
    "lab link": "swarmlab.run.links:RadioLinks",
    "lab cut": "swarmlab.run.links:RadioLinks",
    "lab heal": "swarmlab.run.links:RadioLinks",
    "lab partition": "swarmlab.run.links:RadioLinks",
    "lab logs": "swarmlab.run.listing:ProcessLogLine",
    "lab run": "swarmlab.report.report:ExperimentReport",
    "lab run DISTRIBUTION": "swarmlab.distribution:DistributionReport",
    "lab report": "swarmlab.report.report:ExperimentReport",
    "config get": "swarmctl.commands.config.keys:ConfiguredKeys",
    "config describe": "swarmctl.commands.config.keys:ConfiguredKeys",
    "config set": "swarmctl.resources.access:WriteResult",
    "config undo": "swarmctl.resources.undoing:SettingUndone",
    "config history": "swarmctl.commands.config.changes:SettingHistory",
    "config dump": "swarmctl.commands.config.transfer:DumpedSettings",
    "config load": "swarmctl.commands.config.transfer:SettingsLoaded",
    "config diff": "swarmctl.commands.config.transfer:SettingsDiff",
    "config show": "swarmctl.commands.config.keys:ConfiguredKeys",
    "fleet push": "swarmctl.commands.fleet.plan:FleetStep",
    "fleet up": "swarmctl.commands.fleet.plan:FleetStep",
    "fleet down": "swarmctl.commands.fleet.plan:FleetStep",
    "fleet upgrade": "swarmctl.commands.fleet.plan:FleetStep",
    "fleet ls": "swarmctl.commands.fleet.listing:FleetList",
    "fleet exec": "swarmctl.commands.fleet.executing:FleetOutput",
    "doctor": "swarmctl.commands.doctor.diagnosis:Diagnosis",
    "doctor PLACEMENT": "swarmctl.commands.doctor.placement:Placements",
    "new module": "swarmctl.commands.new.scaffold:NewFolder",
    "new driver": "swarmctl.commands.new.scaffold:NewFolder",
    "new service": "swarmctl.commands.new.scaffold:NewFolder",
    "new block": "swarmctl.commands.new.scaffold:NewFolder",
    "new mission": "swarmctl.commands.new.scaffold:NewFolder",
    "file send": "swarmctl.commands.file.blocks:MovedFile",
    "file get": "swarmctl.commands.file.blocks:MovedFile",
    "file ls": "swarmware.types.file:FileListing",
    "docs": "swarmctl.commands.docs.site:DocumentationPage",
    "nodes": "swarmctl.terminal.node_output:NodeResults",
    "message": "command_schemas:Message",
}
"""`module:type` by command, and of the lines on stderr; imported only where a schema is made."""

NO_DOCUMENT: Final = frozenset({"completion", "log export"})
"""Commands whose result is text or a file in every format."""


class Message(msgspec.Struct, frozen=True, omit_defaults=True):
    """A line on stderr beside a structured result: an error, a warning or a message."""

    error: str = ""
    exit_code: int = 0
    warning: str = ""
    message: str = ""


def schemas() -> Iterator[tuple[str, dict[str, Any]]]:
    """File name and JSON Schema of each command's document, or of each of its lines."""
    for command in DOCUMENTS:
        yield f"{command.lower().replace(' ', '-')}.schema.json", schema(command)


def schema(command: str) -> dict[str, Any]:
    """JSON Schema of a command's document: `schema_version` and the fields of its type."""
    module, _, name = DOCUMENTS[command].partition(":")
    cls = getattr(import_module(module), name)
    defs = json_schema(cls)["$defs"]
    top = defs.pop(name)
    own = "schema_version" in top["properties"]
    version: dict[str, Any] = {"type": "integer"} if own else {"const": SCHEMA_VERSION}
    properties = {**top["properties"], "schema_version": version}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"swarmctl {command}",
        "description": top["description"],
        "type": "object",
        "required": ["schema_version"] if cls.__struct_config__.omit_defaults else list(properties),
        "properties": properties,
        "additionalProperties": False,
        "$defs": defs,
    }
