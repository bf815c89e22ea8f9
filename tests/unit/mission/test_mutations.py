"""Shipped missions, damaged: understood or refused with the errors of the project, as the schema says."""

import copy
import json
from collections import Counter
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

import jsonschema
import pytest
from file_schemas import mission_schema

from swarmware.errors import ConfigError
from swarmware.mission.binding import Binding
from swarmware.mission.budget import QUICK_BYTES, Budget
from swarmware.mission.check import check_folder, check_text
from swarmware.mission.finding import sound
from swarmware.mission.folder import from_files
from swarmware.mission.manifest import MANIFEST
from swarmware.model.config import share_dir
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionFile

FORMATION = share_dir() / "missions" / "formation"
PUBLISHED = Path(__file__).parents[2] / "data" / "bdl"
TEXTS = [path.read_text() for folder in (FORMATION, PUBLISHED) for path in sorted(folder.glob("*.json"))]
VALIDATOR = jsonschema.Draft202012Validator(json.loads(mission_schema()))
BEYOND_FORM = {"no-such-block", "into-start", "start", "end", "condition"}
"""Rules that no schema can express."""
ODD: list[Any] = [
    *(None, True, 0, -1, 1e308, 10**30, "", "$", "$param.x", "a" * 300, "\0", "é→", "NaN", "1e999", " 5"),
    *([], {}, [[]], {"a": 1}, "End", "Fork", "error", "timeout", "battery < 80", "nav/pose.q > 1", "(" * 40),
    *("/a/b.c.d == 'x'", "age(/x)", "٣", "+5", [1, 2, 3], ["b1", "b1"], "all"),
]
KEYS = ["next", "nextTimeout", "on", "timeout", "timeout_s", "type", "cases", "id", "quorum", "zz", "params"]
BITS = [
    '"',
    "{",
    "}",
    "[",
    "]",
    ",",
    "\\",
    "\n",
    "0",
    "$",
    "\x00",
    "é",
    "NaN",
    "1e999",
    "\\u0000",
    '"mission"',
]

Steps = tuple[str | int, ...]


def places(value: Any, steps: Steps = ()) -> list[Steps]:
    """Every place below this value."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    found = [] if not steps else [steps]
    for key, item in inner:
        found += places(item, (*steps, key))
    return found


def at(document: Any, steps: Steps) -> Any:
    for step in steps:
        document = document[step]
    return document


def mutate(chance: Random, document: Any) -> None:
    known = places(document)
    *above, key = chance.choice(known)
    parent = at(document, tuple(above))
    match chance.randrange(4):
        case 0:
            parent[key] = copy.deepcopy(chance.choice(ODD))
        case 1:
            del parent[key]
        case 2:
            parent[key] = copy.deepcopy(at(document, chance.choice(known)))
        case _ if isinstance(parent, dict):
            parent[chance.choice(KEYS)] = copy.deepcopy(chance.choice(ODD))


def damage(chance: Random, text: str) -> str:
    for _ in range(chance.randint(1, 3)):
        place = chance.randrange(len(text) + 1)
        text = text[:place] + chance.choice(BITS) + text[place + chance.randint(0, 3) :]
    return text


@pytest.mark.parametrize("part", range(2))
def test_mutation_is_judged_alike_by_both_readers(part: int) -> None:
    seen: Counter[bool] = Counter()
    for seed in range(part * 150, part * 150 + 150):
        chance = Random(seed)
        document = json.loads(chance.choice(TEXTS))
        for _ in range(chance.randint(1, 4)):
            with suppress(IndexError):  # nothing is left to change
                mutate(chance, document)
        text = json.dumps(document)
        kind = chance.choice(["uav", "ugv", "gcs"])
        reading, findings = check_text(
            text, "m.json", Binding("uav1", PlatformKind(kind)), budget=Budget(QUICK_BYTES)
        )
        "".join(map(str, findings)).encode()
        form = [
            finding
            for finding in reading.findings
            if finding.rule not in BEYOND_FORM and finding.severity == "error"
        ]
        if "$" not in text:
            assert bool(form) != VALIDATOR.is_valid(document), (seed, form)
        seen[sound(findings)] += 1
    assert seen[False] > 100


def test_damaged_text_is_refused_with_findings() -> None:
    files = [MissionFile(path.name, path.read_text()) for path in sorted(FORMATION.iterdir())]
    refused = 0
    for seed in range(150):
        chance = Random(seed)
        text = damage(chance, chance.choice(TEXTS))
        "".join(map(str, check_text(text, "m.json", Binding(), budget=Budget(QUICK_BYTES))[1])).encode()
        victim = chance.randrange(len(files))
        damaged = [
            MissionFile(file.name, damage(chance, file.text))
            if n == victim or file.name == MANIFEST
            else file
            for n, file in enumerate(files)
        ]
        try:
            findings = check_folder(from_files(damaged, "trial"), budget=Budget(QUICK_BYTES))
        except ConfigError as error:
            refused += "trial" in str(error)
        else:
            refused += not sound(findings)
    assert refused > 100


def test_text_outside_utf_8_names_its_file() -> None:
    with pytest.raises(ConfigError, match=r"trial: file 'm\.json'.*expected UTF-8"):
        from_files([MissionFile("m.json", '{"mission": "\ud800"}')], "trial")
