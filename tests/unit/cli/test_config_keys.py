"""The configuration of a node as its node answers: printed, described, changed where it may be changed."""

import io
import json
from pathlib import Path
from typing import Any

import click
import msgspec
import pytest
from tests.unit.cli.session import GET, LIST, RESET, SET, ScriptedSession
from tests.unit.cli.session import value as tree_value

from swarmctl.commandline import word_cache
from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.config.changes import print_history, reset_setting, set_setting, undo_setting
from swarmctl.commands.config.keys import describe, print_keys, print_local
from swarmctl.commands.config.transfer import diff, dump, load
from swarmctl.terminal.output import Output
from swarmware.errors import Denied, InvalidInput, NoAnswer, NotFound, OutOfRange
from swarmware.model.resource import Kind
from swarmware.service.effective import key_pattern
from swarmware.testing.tmpnode import make_node
from swarmware.types.config import ConfigChange, ConfigHistory, ConfigKey, ConfigOrigin, EffectiveConfig
from swarmware.types.tree import TreeEntry, TreeListing, TreeReset, TreeSet, TreeSetDone

KP = "/uav1/config/navigator/altitude_kp"
CONFIG, HISTORY = "/uav1/sys/node/config", "/uav1/sys/tree/history"
pack = msgspec.msgpack.encode


def key(name: str, value: Any, default: Any, **more: Any) -> ConfigKey:
    service, _, plain = name.partition("/")
    known: dict[str, Any] = {
        "origin": ConfigOrigin.DEFAULT, "type": "float", "unit": "Hz", "limits": "[1, 50]", "live": False,
        "service": service, "file": f"/etc/swarm/services/{service}.toml", "key": plain,
        "file_value": pack(value), "meaning": "Rate of the beacon.",
    }  # fmt: skip
    return ConfigKey(name, pack(value), default=pack(default), **(known | more))


AT_NS = 1_763_827_537_000_000_000
TICK = key("broker/tick_hz", 20.0, 10.0, origin=ConfigOrigin.FILE, line=12)
PORT = key(
    "broker/udp_port", 7447, 7447, type="integer", unit="", file_value=pack(7448), pending=True, line=3
)
GAIN = key(
    "navigator/altitude_kp", 4.0, 1.2, origin=ConfigOrigin.LIVE, live=True, unit="1/s", limits="[0, 100]",
    key="altitude.kp_1_s", file_value=pack(1.5), version=3, by="operator@gcs", utc_ns=AT_NS,
)  # fmt: skip
NAME = key(
    "node/platform", "uav1", "uav1", type="string", unit="", limits="", file="/etc/swarm/node.toml", line=1
)


class Node(ScriptedSession):
    """The node uav1, which answers for its configuration."""

    def __init__(self, *keys: ConfigKey, problems: tuple[str, ...] = (), **options: Any) -> None:
        entry = TreeEntry(KP, Kind.SETTING, "Float", unit="1/s", access="rw", range=(0.0, 100.0))
        super().__init__(
            {LIST: TreeListing((entry,)), f"{GET} {KP}": tree_value(KP, 4.0)}, node="uav1", **options
        )
        self.keys, self.problems = keys, problems
        self.changes: list[Any] = []

    async def ask(
        self, path: str, value: Any, reply: type[Any], *, about: str = "", timeout_s: float | None = None
    ) -> Any:
        if path == CONFIG:
            wanted = key_pattern(value.pattern)
            places = {key: f"{key.service}/{key.key}" for key in self.keys}
            found = tuple(key for key in self.keys if wanted(key.name) or wanted(places[key]))
            return EffectiveConfig("uav1", found, self.problems)
        if path == GET and about != KP:
            raise NotFound(f"{about}: no such resource")
        if path in {SET, RESET}:
            assert isinstance(value, TreeSet | TreeReset)
            if about != KP:
                raise NotFound(f"{about}: no such resource")
            plain = 1.5 if isinstance(value, TreeReset) else msgspec.msgpack.decode(value.value)
            if plain > 100:
                raise OutOfRange(f"{about}: {plain}; expected 0 to 100")
            self.changes.append(plain)
            return TreeSetDone(KP, 4, "Float", pack([plain]))
        return await super().ask(path, value, reply, about=about, timeout_s=timeout_s)

    @property
    def printed(self) -> str:
        return self.stdout.getvalue()


@pytest.fixture(autouse=True)
def no_node(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("SWARM_CONFIG", str(tmp_path))


async def test_one_key_is_value_pattern_is_table() -> None:
    session = Node(TICK, GAIN)
    await print_keys(session, "broker/tick_hz", changed=False)
    assert session.printed == "20\n"
    session = Node(TICK, PORT, GAIN, NAME, problems=("/etc/swarm/x.toml: invalid",))
    await print_keys(session, "**", changed=False)
    assert session.printed.splitlines() == [
        "KEY                    VALUE  UNIT  FROM                                   CHANGE",
        "broker/tick_hz         20     Hz    broker.toml:12                         restart",
        "broker/udp_port        7447   -     default (file: 7448, needs a restart)  restart",
        "navigator/altitude_kp  4      1/s   live (file: 1.5)                       live",
        "node/platform          uav1   -     default                                restart",
    ]
    assert "warning: uav1: /etc/swarm/x.toml: invalid" in session.stderr.getvalue()


async def test_values_of_live_settings_are_kept_for_completion() -> None:
    mode = key("tracker/mode", "fast", "slow", live=True, type="string", unit="", limits="fast, slow")
    await print_keys(Node(TICK, GAIN, mode), "**", changed=False)
    assert word_cache.values_of("config/navigator/altitude_kp", "uav1") == (
        ["4", "1.2"],
        "[0, 100] 1/s, default 1.2 1/s",
    )
    assert word_cache.values_of("config/tracker/mode", "")[0] == ["fast", "slow"]
    assert word_cache.values_of("config/broker/tick_hz", "uav1") == ([], ""), "set in its file"


async def test_a_document_has_both_kinds_of_keys() -> None:
    session = Node(TICK, GAIN, output="json")
    await print_keys(session, "**", changed=False)
    tick, gain = session.document["settings"]
    assert (tick["value"], tick["origin"], tick["line"], tick["live"], tick["path"]) == (
        20.0,
        "file",
        12,
        False,
        "",
    )
    assert (gain["value"], gain["file_value"], gain["default"]) == (4.0, 1.5, 1.2)
    assert (gain["path"], gain["changed_by"], gain["version"]) == (KP, "operator@gcs", 3)
    session = Node(TICK, PORT, NAME, output="json")
    await print_keys(session, "**", changed=True)
    assert [one["key"] for one in session.document["settings"]] == ["broker/tick_hz", "broker/udp_port"]


async def test_unknown_key_is_error_with_similar_one() -> None:
    with pytest.raises(NotFound, match=r"has the name 'broker/tik_hz'; did you mean broker/tick_hz\?"):
        await print_keys(Node(TICK, GAIN), "broker/tik_hz", changed=False)
    with pytest.raises(NotFound, match=r"matches 'bogus/\*'; `swarmctl config get` lists"):
        await print_keys(Node(TICK, GAIN), "bogus/*", changed=False)


async def test_node_without_route_is_error_without_file() -> None:
    class Lost(Node):
        async def reach(self, platform: str) -> None:
            raise NoAnswer(f"node {platform!r}: known, but gcs has no route to it now")

    for command in (print_keys(Lost(TICK), "**", changed=False), print_history(Lost(), "**")):
        with pytest.raises(NoAnswer, match="no route"):
            await command


async def test_a_key_is_described_with_what_changes_it() -> None:
    session = Node(TICK, GAIN, NAME)
    await describe(session, ("broker/*", "navigator/altitude_kp"))
    assert session.printed.splitlines() == [
        "broker/tick_hz: Rate of the beacon.",
        "  value   20 Hz, broker.toml:12",
        "  default 10 Hz",
        "  type    float, [1, 50]",
        "  file    /etc/swarm/services/broker.toml, tick_hz",
        "  change  set tick_hz in /etc/swarm/services/broker.toml on uav1, "
        "then `swarmctl app restart broker -n uav1`",
        "",
        "navigator/altitude_kp: Rate of the beacon.",
        "  value   4 1/s, live (file: 1.5)",
        "  default 1.2 1/s",
        "  type    float, [0, 100]",
        "  file    /etc/swarm/services/navigator.toml, altitude.kp_1_s",
        "  changed 2025-11-22T16:05:37.000Z by operator@gcs",
        "  change  swarmctl config set navigator/altitude_kp VALUE -n uav1",
    ]
    session = Node(NAME, output="json")
    await describe(session, ("node/platform",))
    assert session.document["settings"][0]["meaning"] == "Rate of the beacon."


async def test_key_of_file_only_is_refused_with_command() -> None:
    session = Node(TICK, GAIN, NAME)
    with pytest.raises(Denied) as refused:
        await set_setting(session, "broker/tick_hz", "5", yes=True)
    for part in (
        "uav1: broker/tick_hz",
        "set tick_hz in /etc/swarm/services/broker.toml",
        "app restart broker -n uav1",
    ):
        assert part in str(refused.value)
    with pytest.raises(
        Denied, match=r"set platform in /etc/swarm/node\.toml on uav1, then end and start the node"
    ):
        await reset_setting(session, "node/platform", yes=True)
    with pytest.raises(NotFound, match="did you mean broker/tick_hz"):
        await set_setting(session, "broker/tik_hz", "5", yes=True)
    with pytest.raises(InvalidInput, match="a pattern; expected one key"):
        await set_setting(session, "*/altitude_kp", "5", yes=True)
    with pytest.raises(Denied, match="app restart broker"):
        await undo_setting(session, "broker/tick_hz", yes=True)
    assert session.changes == []


async def test_live_setting_is_set_and_reset_by_name() -> None:
    session = Node(TICK, GAIN)
    await set_setting(session, "navigator/altitude_kp", "2.5", yes=True)
    await set_setting(session, "navigator/altitude.kp_1_s", "3.5", yes=True)
    with pytest.raises(OutOfRange, match="expected 0 to 100"):
        await set_setting(session, "navigator/altitude_kp", "101", yes=True)
    assert session.changes == [2.5, 3.5]
    session = Node(msgspec.structs.replace(GAIN, origin=ConfigOrigin.FILE, line=7))
    await reset_setting(session, "navigator/altitude_kp", yes=True)
    assert session.printed == f"{KP} = 1.5 (version 4; navigator.toml:7)\n"


async def test_setting_that_swings_vehicle_resets_only_confirmed() -> None:
    session = Node(GAIN)
    entry = TreeEntry(KP, Kind.SETTING, "Float", access="rw", confirm="it may swing")
    session.answers = {LIST: TreeListing((entry,))}
    with pytest.raises(click.UsageError, match="it may swing"):
        await reset_setting(session, "navigator/altitude_kp", yes=False)
    assert session.changes == []


async def test_history_names_who_changed_what_and_when() -> None:
    name, second_ns = "navigator/altitude_kp", 1_000_000_000
    changes = (
        ConfigChange(name, AT_NS + second_ns, "swarmctl@uav1", pack(4.0), pack(1.5), overrides=False),
        ConfigChange(name, AT_NS, "operator@gcs", pack(1.5), pack(4.0), overrode=False),
    )
    session = Node(GAIN)
    session.answers = {HISTORY: ConfigHistory("uav1", changes)}
    await print_history(session, "**")
    assert session.printed.splitlines()[1:] == [
        "2025-11-22T16:05:38.000Z  navigator/altitude_kp  4           1.5 (file)  swarmctl@uav1",
        "2025-11-22T16:05:37.000Z  navigator/altitude_kp  1.5 (file)  4           operator@gcs",
    ]
    session = Node(GAIN, output="json")
    session.answers = {HISTORY: ConfigHistory("uav1", changes)}
    await print_history(session, "**")
    first = session.document["changes"][0]
    assert (first["before"], first["after"], first["before_origin"], first["after_origin"]) == (
        4.0,
        1.5,
        "live",
        "file",
    )
    session = Node(GAIN)
    session.answers = {HISTORY: ConfigHistory("uav1", ())}
    await print_history(session, "navigator/*")
    assert "no live setting was changed" in session.stderr.getvalue()
    with pytest.raises(NotFound, match="bogus"):
        await print_history(session, "bogus/*")


async def test_comparison_without_platform_prints_deviations_from_files() -> None:
    session = Node(TICK, PORT, GAIN)
    await diff(session, "")
    assert session.printed.splitlines() == [
        "KEY                    uav1  FILE",
        "broker/udp_port        7447  7448",
        "navigator/altitude_kp     4   1.5",
    ]
    session = Node(TICK)
    await diff(session, "")
    assert session.printed == ""
    assert "the values of its files are in force" in session.stderr.getvalue()


async def test_all_keys_are_dumped_and_file_keys_checked(tmp_path: Path) -> None:
    file = tmp_path / "uav1.toml"
    session = Node(TICK, GAIN)
    await dump(session, str(file), files=True)
    assert file.read_text() == '"broker/tick_hz" = 20.0\n"navigator/altitude_kp" = 4.0\n'
    await diff(session, str(file), files=True)
    assert session.printed == ""
    await load(session, str(file), yes=True)
    assert session.changes == []
    file.write_text('"navigator/altitude_kp" = 5.0\n"broker/tick_hz" = 21.0\n')
    with pytest.raises(
        Denied, match=r"broker/tick_hz: it is read from a file at the start only: set tick_hz in"
    ):
        await load(session, str(file), yes=True)
    assert session.changes == []


def test_stopped_nodes_files_and_stored_settings_are_shown(tmp_path: Path) -> None:
    folder = make_node(tmp_path, services={"navigator": {"altitude": {"kp_1_s": 1.5}}})
    data = tmp_path / "uav1/data"
    data.mkdir()
    (data / "settings.toml").write_text('["config/navigator/altitude_kp"]\nvalue = 4.0\nversion = 1\n')
    settings = CliSettings(config=str(folder))

    def shown(wanted: str, *, changed: bool = False) -> list[str]:
        out = io.StringIO()
        print_local(settings, wanted, Output(settings, out, io.StringIO()), changed=changed)
        return out.getvalue().splitlines()

    (kp,) = [line.split("  ") for line in shown("navigator") if "altitude_kp" in line]
    assert [part.strip() for part in kp if part] == [
        "navigator/altitude_kp",
        "4",
        "1/s",
        "live (file: 1.5)",
        "live",
    ]
    assert len(shown("navigator", changed=True)) == 2
    assert len(shown("node")) > 10
    with pytest.raises(NotFound, match="expected keys of node, navigator"):
        shown("bogus")
    document = io.StringIO()
    print_local(
        CliSettings(config=str(folder), output="json"),
        "",
        Output(CliSettings(output="json"), document),
        changed=False,
    )
    found = {one["key"]: one for one in json.loads(document.getvalue())["settings"]}
    assert (found["navigator/altitude_kp"]["origin"], found["node/platform"]["value"]) == ("live", "uav1")
