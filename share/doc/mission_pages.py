"""Tables of the reference of mission files: keys, blocks, conditions and formations, from the code."""

import inspect
from pathlib import Path

from reference_pages import Key, head, keys, row

from swarmware.geometry.formation import SHAPES, place
from swarmware.mission import condition, condition_parser
from swarmware.mission.binding import VARIABLES
from swarmware.mission.block_reader import TIMEOUT_LIMIT_S, TIMEOUT_MIN_MS
from swarmware.mission.catalogue import BLOCKS, BlockType
from swarmware.mission.file_keys import BLOCK_KEYS, MISSION_KEYS, FileKey
from swarmware.mission.folder import FILE_LIMIT
from swarmware.mission.loader import MISTAKES_LIMIT
from swarmware.mission.manifest import Manifest, Series
from swarmware.mission.model import ON_FAILURE, STEPS_LIMIT
from swarmware.model.document import SIZE_LIMIT

HERE = Path(__file__).parent / "reference"
SLOTS = 6
"""Slots of a formation that the page shows."""
VARIABLE_MEANING = {
    "id": "name of the platform; also `$mavid`, as in published missions",
    "kind": "kind of the platform: `uav`, `ugv`, `usv` or `gcs`",
    "role": "role of the platform; `all` in a mission of a single file",
    "mission": "name of the mission",
}
COMPARISONS = {
    "<": "less",
    "<=": "less or equal",
    ">": "greater",
    ">=": "greater or equal",
    "==": "equal",
    "!=": "not equal",
}


def mission_files() -> str:
    """The generated part of the page."""
    return "".join(
        (_manifest(), _mission_file(), _variables(), _blocks(), _conditions(), _formations(), _limits())
    )


def _table(found: list[Key]) -> str:
    rows = [row(f"`{key.name}`", *key[1:]) for key in found]
    return head("key", "type", "unit", "default", "range", "meaning") + "".join(rows)


def _manifest() -> str:
    series = list(keys(Series, "roles[].params.<name>."))
    return (
        f"\n## mission.toml\n\n{inspect.getdoc(Manifest)}\n\n"
        + _table([*keys(Manifest), *series])
        + "\nA table with `first` and `step` is a series: the first platform of the role has `first`, the "
        "next one `first + step`, and so on.\n"
    )


def _file_keys(found: tuple[FileKey, ...]) -> str:
    rows = [row(f"`{key.name}`", key.type, key.default, key.meaning) for key in found]
    return head("key", "type", "default", "meaning") + "".join(rows)


def _mission_file() -> str:
    return (
        "\n## A role's file (BDL)\n\nKeys at the top of the file:\n\n"
        + _file_keys(MISSION_KEYS)
        + f"\n`on_failure` is {', '.join(f'`{name}`' for name in ON_FAILURE)}.\n\n"
        + "Keys of each block, beside its parameters:\n\n"
        + _file_keys(BLOCK_KEYS)
        + f"\n`timeout_s` is above 0 and at most {TIMEOUT_LIMIT_S:.0f}, `timeout` from {TIMEOUT_MIN_MS:.0f} "
        f"to {TIMEOUT_LIMIT_S * 1000:.0f}; only one of the two is given. Successors for single errors are "
        "named in `on` by the error, such as `blocked`, or as `error:blocked`.\n"
    )


def _variables() -> str:
    rows = [row(f"`${name}`", VARIABLE_MEANING[name]) for name in VARIABLES]
    return (
        "\n## Variables\n\nEvery text of a role's file may contain these variables:\n\n"
        + head("variable", "value")
        + "".join(rows)
        + row("`$param.<name>`", "parameter of the file; a text that consists of it alone gets its type")
    )


def _blocks() -> str:
    return "\n## Blocks\n" + "".join(_block(block) for block in BLOCKS)


def _block(block: BlockType) -> str:
    facts = [
        ("platforms", ", ".join(f"`{kind.value}`" for kind in block.kinds) or "all"),
        ("default time-out", _timeout(block)),
        ("errors", ", ".join(f"`{kind}`" for kind in block.errors) or _no_errors(block)),
        ("after a suspension", f"`{block.resume}`" if block.resumes else "nothing: the block takes no time"),
    ]
    out = [f"\n### {block.name}\n\n{block.purpose}\n\n", head("", "")]
    out += [row(*fact) for fact in facts]
    if found := list(keys(block.params)):
        spellings: dict[str, list[str]] = {}
        for other, name in block.aliases:
            spellings.setdefault(name, []).append(f"`{other}`")
        out.append("\n" + head("parameter", "also", "type", "unit", "default", "range", "meaning"))
        out += [
            row(f"`{key.name}`", ", ".join(spellings.get(key.name, [])), *_as_json(key)[1:]) for key in found
        ]
    return "".join(out)


def _as_json(key: Key) -> Key:
    """The key with the names of JSON types, and the unit of parameters that are named like one."""
    kind = key.type.replace("floats", "numbers").replace("float", "number")
    return key._replace(type=kind, unit=key.unit or (key.name if key.name in {"s", "ms"} else ""))


def _timeout(block: BlockType) -> str:
    if block.timeout_s is not None:
        longer = " + its duration" if "lasts_s" in vars(block.params) else ""
        return f"{block.timeout_s:g} s{longer}"
    return "none" if block.can_time_out else "none, because it cannot time out"


def _no_errors(block: BlockType) -> str:
    return "errors of its program" if block.can_fail else "none, because it cannot fail"


def _conditions() -> str:
    symbols = [row(f"`{symbol}`", COMPARISONS[symbol]) for symbol in condition.COMPARISONS]
    short = [row(f"`{name}`", f"`{'.'.join(field)}`") for name, field in condition_parser.SHORT_NAMES.items()]
    return (
        "\n## Conditions\n\nIn `requires` and in the cases of a Decision. An operand is a number (`80 %` is "
        "0.8), a `'text'`, `true`, `false`, `<resource>.<field>`, or `age(<resource>)` in seconds; `and`, "
        "`or`, `not` and parentheses combine comparisons; `absent(<resource>.<field>)` holds while there is "
        "no value.\n\n"
        "An element of a map is named by its key in brackets, or after a dot where the key is a plain word: "
        '`health/state.sensors["sensor/gnss"]`. An item of a list is named by its index from 0: '
        "`hal/drivers.drivers[0].state`. A quoted text in the brackets of a list of texts asks whether the "
        'list contains it: `health/state.faults["battery/charge=warn"]`.\n\n'
        + head("comparison", "holds when the left side is … the right one")
        + "".join(symbols)
        + "\n"
        + head("short name", "resource and field")
        + "".join(short)
        + f"\nAt most {condition_parser.LENGTH_LIMIT} characters, nested at most "
        f"{condition_parser.DEPTH_LIMIT} deep. "
        "A condition on a resource without a value is unknown: "
        "a Decision ends with the error `unknown_value`.\n"
    )


def _formations() -> str:
    numbers = range(SLOTS)
    out = [
        "\n## Formations\n\nPlace of each slot relative to the head of the shape (slot 0): forward and left, "
        "in multiples of `spacing_m`. `offset_m` moves the whole shape relative to the leader.\n\n",
        head("shape", *(f"slot {number}" for number in numbers)),
    ]
    for shape in SHAPES:
        places = (place(shape, number, 1.0) for number in numbers)
        out.append(row(f"`{shape}`", *(f"{_signed(ahead)}, {_signed(left)}" for ahead, left in places)))
    return "".join(out)


def _signed(value: float) -> str:
    return f"{value + 0.0:g}".replace("-", "−")


def _limits() -> str:
    return (
        "\n## Limits\n\n"
        + head("limit", "value")
        + row("files of a mission", str(FILE_LIMIT))
        + row("size of a file", f"{SIZE_LIMIT >> 20} MiB")
        + row("blocks without duration in sequence", str(STEPS_LIMIT - 1))
        + row("reported errors of a file", str(MISTAKES_LIMIT))
    )


REFERENCE = {HERE / "mission-files.md": mission_files}
"""What of the page is made from the code."""
