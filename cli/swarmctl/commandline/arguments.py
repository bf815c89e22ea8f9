"""Meaning of the arguments of commands, for the part `Arguments` of their help."""

from typing import Final

PATHS: Final = "`*` matches in one segment, `**` at any depth, `{a,b}` alternatives; quote it in a shell."

ARGUMENTS: Final = {
    "condition": "Condition as in missions, in quotes: fields of the resource, <, ==, and, or, not, age().",
    "experiment": "Name of the experiment: formation.",
    "folder": "Folder of a run, as `lab run` printed it.",
    "hosts_file": "File of hosts; `swarmctl docs reference/hosts` describes it.",
    "key": "Key SERVICE/NAME or a pattern of keys; without it all keys.",
    "keys": "Keys SERVICE/NAME.",
    "mission": "Name in the store of the ground station, folder, or file in BDL.",
    "mission cancel run_id": "Number of the run, from `mission queue`.",
    "mission prioritize run_id": "Number of the run, from `mission queue`.",
    "priority": "Priority from 0 to 99; a higher one suspends a lower one.",
    "mission import source": "Plan of QGroundControl, or file of waypoints.",
    "missions": "Files in BDL, folders of missions, or names of shipped missions.",
    "name": "Name: small letters, digits and _.",
    "other": "File of `config dump`, or the platform to compare with.",
    "page": "Page of the documentation, such as howto/logs; without it the first page.",
    "path": f"/PLATFORM/RESOURCE or a pattern: {PATHS}",
    "pattern": f"/PLATFORM/RESOURCE, a branch, or a pattern: {PATHS}",
    "platform": "Name of the platform.",
    "platforms": "Names or patterns of platforms: uav1, 'uav*', 'uav{1,3}'.",
    "services": "Names of services, as `node info` prints them.",
    "shell": "The shell: bash, zsh or fish.",
    "token": "The word that `swarmctl keys invite` printed.",
    "value": "JSON, one plain word, or a word field=value for each field.",
    "node rename new": "Name of the platform from its next start on.",
    "keys invite platforms": "Names of platforms, as in `node.toml` of each.",
    "doctor subject": "`placement`, to check only how applications are placed on computers.",
    "call path": "/PLATFORM/COMMAND, or a COMMAND of the platform of -n.",
    "pub path": "Path on the joined node, such as test/height.",
    "tree get path": f"/PLATFORM/RESOURCE, with .FIELD for a field, or a pattern: {PATHS}",
    "tree watch path": f"/PLATFORM/RESOURCE, with .FIELD for a field, or a pattern: {PATHS}",
    "tree set path": "/PLATFORM/RESOURCE, with .FIELD for a field; the platform may be a pattern.",
    "tree undo path": "/PLATFORM/config/… of a setting; the platform may be a pattern.",
    "tree rule pattern": f"/PLATFORM/RESOURCE, or a pattern; without it all rules of the platform. {PATHS}",
    "tree dump pattern": f"/PLATFORM, /PLATFORM/RESOURCE, or a pattern; without it the whole swarm. {PATHS}",
    "tree load file": "File of `tree dump`.",
    "tree diff one": "File of `tree dump`, a platform, or a pattern.",
    "tree diff other": "File of `tree dump`, platform or pattern to compare with; else the present tree.",
    "tree set value": "JSON or a plain word.",
    "config set value": "JSON or a plain word.",
    "tree type name": "Name of a type, or path of a resource.",
    "wait path": "/PLATFORM/RESOURCE, which may not exist yet; the platform may be a pattern.",
    "traffic channels pattern": f"Only channels of these resources; without it all channels. {PATHS}",
    "traffic set pattern": f"RESOURCE, or a pattern: {PATHS}",
    "health clear pattern": f"Name of a check, such as age/nav/pose, or a pattern: {PATHS}",
    "file send file": "File of this computer.",
    "file get name": "Name of the file at the node, as `file ls` shows it.",
    "fleet exec words": "Command and its arguments after --, which reach the host unchanged.",
    "config diff other": "File of `config dump`, or the platform to compare with.",
    "config load file": "File of `config dump`.",
    "config dump file": "File to write; without it stdout.",
    "video start source": "/PLATFORM/SOURCE: a source by its name, or the path of a stream of images.",
    "video rate session": "Number of the session, as `video ls` shows it.",
    "video rate bitrate": "Bit rate, such as 1mbit or 500kbit.",
    "video stop session": "Number of the session, as `video ls` shows it.",
    "lab link one": "Node or pattern; without it all nodes.",
    "lab link other": "Node or pattern at the other end; without it all nodes.",
    "lab cut one": "Node or pattern.",
    "lab cut other": "Node or pattern at the other end; without it all nodes.",
    "lab heal one": "Node or pattern; without it all nodes.",
    "lab heal other": "Node or pattern at the other end; without it all nodes.",
    "lab partition groups": "Nodes or patterns with commas between them, a word for each group.",
    "lab down name": "Name of the lab; without it the only lab.",
}
"""Meanings by the name of the argument, or by the words of the command and the name."""


def meaning(command_path: str, name: str) -> str:
    """Meaning of an argument of a command such as `swarmctl tree get`, or "" if unknown."""
    words = command_path.partition(" ")[2]
    return ARGUMENTS.get(f"{words} {name}", ARGUMENTS.get(name, ""))
