"""Keys of a mission file (BDL) beside the parameters of blocks: one table for reader and documentation."""

from typing import Final

import msgspec


class FileKey(msgspec.Struct, frozen=True):
    """A key of a mission file."""

    name: str
    type: str
    default: str
    meaning: str


MISSION_KEYS: Final = (
    FileKey("mission", "object", "required", "The blocks by name: exactly one Start, at least one End."),
    FileKey(
        "params",
        "object",
        "`{}`",
        "Parameters and their defaults: a number, a text, true, false or a list of points; used as "
        "`$param.<name>`.",
    ),
    FileKey(
        "requires",
        "array of strings",
        "`[]`",
        "Conditions that must hold before the start; evaluated again every second during the mission.",
    ),
    FileKey("on_failure", "string", '`"land"`', "Built-in mission that runs when this mission fails."),
    FileKey(
        "on_link_loss",
        "string",
        "setting `mission/link_loss` of the platform",
        "Action when the vehicle has lost the link to every ground station: `continue`, or the "
        "built-in mission `hold`, `return` or `land`, which ends this mission.",
    ),
    FileKey(
        "priority",
        "number",
        "`0`",
        "From 0 to 99: a mission of higher priority suspends one of lower priority, which continues later.",
    ),
    FileKey(
        "tolerance_s",
        "number",
        "`30`",
        "Time for which the others wait at a barrier for a member whose part is suspended.",
    ),
    FileKey("title", "string", "", "Text for readers about the purpose of the mission."),
    FileKey("comment", "string", "", "Comment for readers."),
    FileKey("$schema", "string", "", "Address of the JSON Schema, for editors."),
)
"""Keys at the top of a mission file."""

BLOCK_KEYS: Final = (
    FileKey("type", "string", "required", "Type of the block, as in the sections below."),
    FileKey(
        "next",
        "string, of a Fork an array of strings",
        "required, except of an End",
        "Block that follows when this block has completed; for a Fork, all blocks that it starts.",
    ),
    FileKey("timeout_s", "number", "of the type", "Time-out in seconds."),
    FileKey("timeout", "number", "of the type", "Time-out in milliseconds, as in published BDL."),
    FileKey(
        "nextTimeout", "string", "", "Block that follows the time-out; also `next_timeout`, `on.timeout`."
    ),
    FileKey("nextError", "string", "", "Block that follows any other error; also `next_error`, `on.error`."),
    FileKey("on", "object", "", 'Blocks that follow single errors: `{"<error>": "<block>"}`.'),
    FileKey(
        "cases",
        "array of objects",
        "required of a Decision",
        'Branches `{"if": "<condition>", "next": "<block>"}`: the first whose condition holds is taken.',
    ),
    FileKey("nextIfTrue", "string", "required of a DecisionRandom", "First successor of a DecisionRandom."),
    FileKey("nextIfFalse", "string", "required of a DecisionRandom", "Second successor of a DecisionRandom."),
    FileKey(
        "resume",
        "string",
        "of the type",
        "How the block continues after a suspension: `restart`, `continue`, `skip` or `abort`.",
    ),
    FileKey("title", "string", "", "Title for readers."),
    FileKey("comment", "string", "", "Comment for readers."),
)
"""Keys that blocks have beside their parameters."""
