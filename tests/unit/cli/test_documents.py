"""The JSON Schemas of what commands print."""

import json
import re
from collections.abc import Iterator

import click
import command_schemas
import jsonschema
import pytest

from swarmctl.main import cli
from swarmctl.main import main as swarmctl
from swarmware.model.config import share_dir
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.json_form import json_form, json_schema
from swarmware.types.system import NodeInfo

SHIPPED = share_dir() / "schemas" / "swarmctl"
SCHEMAS = dict(command_schemas.schemas())


def leaves(group: click.Group, ctx: click.Context, words: tuple[str, ...] = ()) -> Iterator[str]:
    for name in group.list_commands(ctx):
        command = group.get_command(ctx, name)
        if isinstance(command, click.Group):
            yield from leaves(command, click.Context(command, parent=ctx), (*words, name))
        elif command is not None and not command.hidden:
            yield " ".join((*words, name))


def test_every_command_has_schema_or_prints_no_document() -> None:
    known = {re.sub(" [A-Z]+$", "", command) for command in command_schemas.DOCUMENTS} - {"message", "nodes"}
    assert set(leaves(cli, click.Context(cli))) == known | command_schemas.NO_DOCUMENT


@pytest.mark.parametrize("name", SCHEMAS)
def test_a_shipped_schema_is_that_of_the_code(name: str) -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMAS[name])
    assert json.loads((SHIPPED / name).read_text()) == SCHEMAS[name], "`make docs` writes it"


def test_no_schema_of_removed_command_is_shipped() -> None:
    assert {path.name for path in SHIPPED.iterdir()} == set(SCHEMAS)


def test_the_form_of_a_value_matches_its_schema() -> None:
    info = NodeInfo(
        "uav1", "main", PlatformKind.UAV, "multirotor", "0.1", 2**63, 1.5, ("broker",), "/etc/swarm", "one"
    )
    schema = json_schema(NodeInfo)
    jsonschema.validate(json_form(info), schema)
    assert json_form(info)["boot_id"] == str(2**63)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(json_form(info) | {"boot_id": 2**63}, schema)


@pytest.mark.parametrize(
    "words",
    [
        ["--json", "tree", "get", "x", "y"],
        ["node", "lss", "-o", "json"],
        ["-ojsonl", "node", "ls", "--lab", "none"],
        ["topo", "--dot", "--output=json"],
    ],
)
def test_error_is_json_when_result_would_be(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    code = swarmctl(words)
    shown = capsys.readouterr()
    assert shown.out == ""
    found = json.loads(shown.err)
    jsonschema.validate(found, SCHEMAS["message.schema.json"])
    assert found["exit_code"] == code != 0
    assert found["error"]
