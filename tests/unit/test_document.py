"""Every kind of file that is read: whatever stands in it, it is taken or refused by name and line."""

import codecs
import contextlib
import json
import os
import re
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest
import tomli_w
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from swarmctl.commands.config import keys as config_keys
from swarmctl.session import labs
from swarmd.health.journal import JournalFile
from swarmd.tree.settings.store import SettingsStore
from swarmlab.report.run_metadata import RunMetadata
from swarmware.errors import ConfigError, SwarmError, WireError
from swarmware.geometry.world import World
from swarmware.mission.manifest import Manifest
from swarmware.model import config, document, template
from swarmware.model.config import NodeConfig, share_dir
from swarmware.model.stored_setting import SettingChange
from swarmware.transport.appfile.entry import AppEntry, decode, encode
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.root import make_swarm

DEEP = 5_000
BOMBS = {
    "nested arrays": "x = " + "[" * DEEP + "]" * DEEP,
    "nested arrays, never closed": "x = " + "[" * DEEP,
    "nested tables": "x = " + "{a = " * DEEP + "1" + "}" * DEEP,
    "nested keys": ".".join(["a"] * DEEP) + " = 1",
    "nested headers": "[" + ".".join(["a"] * DEEP) + "]",
    "a number of 5 000 digits": "\nx = " + "9" * 5_000,
    "a number of 100 bits": "x = " + str(1 << 100),
    "a negative one": "x = -" + str(1 << 64),
    "infinity": "x = inf",
    "no number": "x = [{y = nan}]",
    "a control character": "x = 'a\x01b'",
    "twice": "x = 1\nx = 2",
}


@pytest.mark.parametrize("bomb", BOMBS)
def test_unreadable_toml_is_refused_with_source(bomb: str) -> None:
    with pytest.raises(ConfigError, match=r"^node\.toml: "):
        document.toml(BOMBS[bomb], "node.toml")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("a = 1\nb = " + "9" * 5_000, "f: line 2: invalid TOML: a number of more than 64 bits"),
        ("a = 1\n\nb = " + "[" * DEEP + "]" * DEEP, "f: line 3: nested more than 32 deep"),
        ("a = 1\nb = ", "f: line 2: invalid TOML: Invalid value (at end of document)"),
        ("a = 1\nb = ?\n", "f: line 2: invalid TOML: Invalid value (at line 2, column 5)"),
        ("a = 1\n" + "a." * DEEP + "b = 1", "f: line 2: a key of more than 32 parts"),
        ("[a]\nb = [1.0, -inf]", "f: line 2: key a.b[1]: -inf; expected a finite number"),
        ("[a]\nb = 36893488147419103232", "f: line 2: key a.b: a number of more than 64 bits"),
    ],
)
def test_line_or_key_of_mistake_is_named(content: str, message: str) -> None:
    with pytest.raises(ConfigError, match="^" + re.escape(message) + "$"):
        document.toml(content, "f")


def test_binary_or_endless_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "node.toml"
    path.write_bytes(b'platform = "uav1"\nkind = "\xff"\n')
    with pytest.raises(ConfigError, match=r"node\.toml: line 2: cannot be read: not UTF-8"):
        document.read(path)
    with pytest.raises(ConfigError, match=r"/dev/zero: more than \d+ bytes"):
        document.read(Path("/dev/zero"))
    with pytest.raises(ConfigError, match="cannot be read: Is a directory"):
        document.read(tmp_path)


@pytest.mark.parametrize(
    "content",
    [
        "[" * DEEP,
        '{"unknown": ' + "[" * DEEP + "]" * DEEP + "}",
        '{"boot_id": ' + "9" * 5_000 + "}",
        '{"boot_id": Infinity}',
        '{"boot_id": 1e999}',
        '{"boot_id": 1',
        '{"\x00": 1}',
        "null",
    ],
    ids=lambda content: content[:20],
)
def test_unreadable_json_is_refused_with_source(content: str) -> None:
    with pytest.raises(ConfigError, match=r"^lab\.json: "):
        document.json(content, labs.LabState, "lab.json")


def node_toml(path: Path) -> None:
    config.load(path, NodeConfig)


def world(path: Path) -> None:
    config.load(path, World)


def manifest(path: Path) -> None:
    config.load(path, Manifest)


def resource_template(path: Path) -> None:
    template.load(path.stem, path.parent)


def application(path: Path) -> None:
    with contextlib.suppress(WireError):
        decode(path.read_bytes(), path.name)


def live_settings(path: Path) -> None:
    # kept aside, never fatal
    assert SettingsStore(path).get("config/x") is None or not list(path.parent.glob("*.broken-*"))
    for broken in path.parent.glob("*.broken-*"):
        broken.unlink()


def shown_configuration(path: Path) -> None:
    path = path.rename(path.with_name("node.toml"))
    config_keys.local_keys(path.parent, "node/*")


def lab(path: Path) -> None:
    path.rename(path.with_name(labs.FILE))
    labs.load(path.parent)


def facts(path: Path) -> None:
    document.json(document.read(path), RunMetadata, str(path))


def journal(path: Path) -> None:
    path.rename(path.with_name("journal.json"))
    JournalFile(path.parent, 1).load()


def roster(path: Path) -> None:
    keys = path.parent / "keys"
    if not keys.exists():
        make_swarm(keys, ["uav1"])
    (keys / "uav1" / "roster.json").write_bytes(path.read_bytes())
    Keys.load(keys / "uav1", "uav1")


def former_group_keys(path: Path) -> None:
    keys = path.parent / "keys"
    if not keys.exists():
        make_swarm(keys, ["uav1"])
    former = keys / "uav1" / "group.keys"
    former.write_bytes(path.read_bytes())
    former.chmod(0o600)
    Keys.load(keys / "uav1", "uav1")


READERS = [
    node_toml,
    world,
    manifest,
    resource_template,
    application,
    live_settings,
    shown_configuration,
    lab,
    facts,
    journal,
    roster,
    former_group_keys,
]

SHARE = share_dir()
_ENTRY = AppEntry(
    name="x", instance=1, pid=2, pid_start=3, endpoint="ipc:///x", started_ns=4, config={"a": {"b": 1}}
)
SOUND = [
    tomli_w.dumps({"platform": "uav1", "clock": {"offset_s": 1.0}}).encode(),
    (SHARE / "templates" / "common.toml").read_bytes(),
    next(iter(sorted((SHARE / "worlds").glob("*.toml")))).read_bytes(),
    (SHARE / "missions" / "formation" / "mission.toml").read_bytes(),
    encode(_ENTRY),
    b'["config/x"]\nvalue = 1.5\nversion = 3\n',
    json.dumps({"boot_id": 1, "registrations": [], "faults": []}).encode(),
]
_bombs = [text.encode() for text in BOMBS.values()]
_scraps = [
    *_bombs,
    b"\xff\xfe",
    b"[" * 3_000,
    b'{"a":' * 3_000,
    b"9" * 5_000,
    b"nan",
    b"1e999",
    b'"',
    b"\x00",
    b"\n",
]


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    """A sound file of some kind in which a piece is cut, doubled, or replaced by something awkward."""
    data = bytearray(draw(st.sampled_from(SOUND)))
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(data)))
        end = min(len(data), at + draw(st.integers(0, 30)))
        data[at:end] = draw(st.one_of(st.sampled_from(_scraps), st.binary(max_size=8)))
    return bytes(data)


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.__name__)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.one_of(damaged(), st.sampled_from([*SOUND, *_scraps]), st.binary(max_size=40)))
@example(content=_bombs[0])
@example(content=_bombs[3])
@example(content=_bombs[5])
def test_any_file_is_accepted_or_explained(
    tmp_path: Path, reader: Callable[[Path], None], content: bytes
) -> None:
    path = tmp_path / "file.toml"
    path.write_bytes(content)
    try:
        reader(path)
    except SwarmError as error:
        assert str(tmp_path) in str(error) or os.sep not in str(error)
    finally:
        path.unlink(missing_ok=True)


def test_deeply_nested_application_file_is_refused() -> None:
    text = encode(_ENTRY).decode().rpartition("# crc32")[0].replace("b = 1", "b = " + "[" * DEEP + "]" * DEEP)
    data = f"{text}# crc32 {zlib.crc32(text.encode()):08x}\n".encode()
    with pytest.raises(WireError, match=r"x\.toml: not an application file: .*nested"):
        decode(data, "x.toml")


def test_setting_that_is_infinite_is_kept_over_restart(tmp_path: Path) -> None:
    store = SettingsStore(tmp_path / "settings.toml")
    store.put("config/limit", SettingChange(utc_ns=1, by="", before=0.0, after=float("inf")))
    kept = SettingsStore(tmp_path / "settings.toml").get("config/limit")
    assert kept is not None
    assert kept.value == float("inf")


@pytest.mark.parametrize("content", ["a = 1\n", "[a]\nb = 'ü'\n", ""])
def test_a_byte_order_mark_is_skipped(content: str, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(codecs.BOM_UTF8 + content.encode())
    assert document.read(path) == content
    assert document.toml(document.read(path), "a.toml") == document.toml(content, "a.toml")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-32-be"])
def test_another_encoding_is_named_with_what_to_do(encoding: str) -> None:
    marked = {"utf-32-be": codecs.BOM_UTF32_BE}.get(encoding, b"")
    with pytest.raises(ConfigError, match=r"^f: cannot be read: UTF-16 or UTF-32; save as UTF-8$"):
        document.text(marked + "platform = 'uav1'".encode(encoding), "f")
