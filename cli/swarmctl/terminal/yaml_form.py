"""Documents as YAML: the data of their JSON, without raw control characters."""

from typing import Any

import msgspec
import yaml

from swarmware.model.visible import HIDDEN, json_escaped


class _Dumper(yaml.SafeDumper):
    """Writes texts with control characters between double quotes, where YAML has escape sequences."""


def _text(dumper: _Dumper, text: str) -> yaml.ScalarNode:
    # a text of several lines, too: its block could hold the others raw
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"' if HIDDEN.search(text) else None)


_Dumper.add_representer(str, _text)


def yaml_text(form: Any) -> str:
    """One document of YAML, with enumerations, instants and bytes as in JSON."""
    plain = msgspec.json.decode(msgspec.json.encode(form))
    text: str = yaml.dump(plain, Dumper=_Dumper, sort_keys=False, allow_unicode=True, explicit_start=True)
    return json_escaped(text)
