"""One list of a node's configuration: each key once, with the value in force and where it comes from."""

from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import pytest

from swarmware.errors import ConfigError, InvalidInput
from swarmware.model.config import load_node, load_service
from swarmware.model.resource import Kind, Resource
from swarmware.model.stored_setting import LiveValue, SettingChange, StoredSetting
from swarmware.service.config_keys import described_keys
from swarmware.service.effective import NODE, effective_config, key_pattern
from swarmware.service.installed import find, installed
from swarmware.testing.tmpnode import make_node
from swarmware.types.config import ConfigKey, ConfigOrigin

KP = Resource(
    path="config/navigator/altitude_kp", kind=Kind.SETTING, type="Float", unit="1/s", range=(0.0, 100.0),
    default=1.2, access="rw",
)  # fmt: skip
LIMIT = Resource(
    path="config/motor/mode", kind=Kind.SETTING, type="Text", choices=("eco", "full"), default="eco",
    access="rw", description="Mode of the motor",
)  # fmt: skip


def plain(data: bytes) -> Any:
    return msgspec.msgpack.decode(data)


def keys(folder: Path, **more: Any) -> dict[str, ConfigKey]:
    found = effective_config(folder, **({"running": {}, "live": {}} | more))
    assert [name for name, count in Counter(key.name for key in found.keys).items() if count > 1] == []
    return {key.name: key for key in found.keys}


def in_force(folder: Path, service: str) -> dict[str, Any]:
    """The configuration as the application file of the running service has it: without None."""
    cls = find(service).Config
    found = msgspec.to_builtins(load_service(folder, service, cls))
    assert isinstance(found, dict)
    return {key: value for key, value in found.items() if value is not None}


def test_every_key_is_listed_with_description(
    tmp_path: Path,
) -> None:
    services = [
        name
        for name, point in installed().items()
        if point.value.startswith("swarmd.") and not find(name).settings_of
    ]
    found = keys(make_node(tmp_path, services={name: {} for name in services}), meanings=True)
    for service in services:
        of_service = [key for key in found.values() if key.service == service]
        assert [key.key for key in of_service] == [one.name for one in described_keys(find(service).Config)]
    for key in found.values():
        assert key.meaning, key.name
        assert key.type, key.name
    assert (found["node/log_level"].limits, found["node/log_level"].type) == (
        "DEBUG, ERROR, INFO, WARNING",
        "string",
    )
    assert found["navigator/air.v_max_m_s"].unit == "m/s"
    assert found["broker/tick_hz"].limits == "[1, 50]"
    assert not any(key.meaning for key in keys(tmp_path / "uav1/etc").values())


def test_value_has_file_and_line_or_default(tmp_path: Path) -> None:
    folder = make_node(tmp_path, services={"broker": {"tick_hz": 20.0, "udp_port": 7447}})
    found = keys(folder, running={"broker": in_force(folder, "broker")})
    tick, port, seeds = (found[f"broker/{key}"] for key in ("tick_hz", "udp_port", "seeds"))
    assert (plain(tick.value), tick.origin, tick.line, plain(tick.default)) == (20.0, "file", 1, 10.0)
    assert tick.file == str(folder / "services/broker.toml")
    assert (port.origin, port.line) == ("file", 2), "written, although it is the default"
    assert (plain(seeds.value), seeds.origin, seeds.line) == ([], ConfigOrigin.DEFAULT, 0)
    assert not any(key.pending for key in found.values())
    assert (tick.running, found["node/platform"].running) == (True, False)
    assert found["node/platform"].line > 0


def test_file_that_was_changed_after_start_is_pending(tmp_path: Path) -> None:
    folder = make_node(tmp_path, services={"broker": {"tick_hz": 20.0}})
    running = {"broker": in_force(folder, "broker"), NODE: msgspec.to_builtins(load_node(folder))}
    (folder / "services/broker.toml").write_text("udp_port = 7448\n")
    found = keys(folder, running=running)
    assert [key.name for key in found.values() if key.pending] == ["broker/udp_port", "broker/tick_hz"]
    tick, port = found["broker/tick_hz"], found["broker/udp_port"]
    assert (plain(tick.value), tick.origin, plain(tick.file_value)) == (20.0, "file", 10.0)
    assert (plain(port.value), port.origin, plain(port.file_value)) == (7447, "default", 7448)


def test_invalid_file_is_problem_and_settings_stay(tmp_path: Path) -> None:
    folder = make_node(tmp_path, services={"broker": {"tick_hz": 20.0}, "tree": {}})
    running = {"broker": in_force(folder, "broker")}
    node = load_node(folder)
    (folder / "services/broker.toml").write_text("tick_hz = 900.0\n")
    (folder / "node.toml").write_text("nonsense [")
    with pytest.raises(ConfigError, match="invalid TOML"):
        effective_config(folder, {}, {})
    found = effective_config(folder, running, {}, node=node)
    assert [problem.partition(": ")[0] for problem in found.problems] == [
        str(folder / "node.toml"),
        str(folder / "services/broker.toml"),
    ]
    tick = next(key for key in found.keys if key.name == "broker/tick_hz")
    assert (plain(tick.value), tick.origin, tick.file_value, tick.pending) == (20.0, "file", b"", False)
    assert effective_config(folder, running, {}, "tree/*", node=node).problems == ()


def test_live_setting_and_its_file_key_unite(tmp_path: Path) -> None:
    folder = make_node(tmp_path, services={"navigator": {"altitude": {"kp_1_s": 1.5}}})
    running = {"navigator": in_force(folder, "navigator")}
    untouched = keys(folder, running=running, live={KP.path: LiveValue(KP, 1.5, None)})
    kp = untouched["navigator/altitude_kp"]
    assert "navigator/altitude.kp_1_s" not in untouched
    assert (plain(kp.value), kp.origin, kp.line, kp.key) == (1.5, "file", 2, "altitude.kp_1_s")
    assert (kp.live, kp.version, kp.utc_ns, kp.limits) == (True, 0, 0, "[0, 100]")
    change = SettingChange(utc_ns=7, by="operator@gcs", before=1.5, after=4.0, overrode=False)
    stored = StoredSetting(value=4.0, version=1, history=(change,))
    kp = keys(folder, running=running, live={KP.path: LiveValue(KP, 4.0, stored)})["navigator/altitude_kp"]
    assert (plain(kp.value), kp.origin, plain(kp.file_value)) == (4.0, "live", 1.5)
    assert (kp.version, kp.by, kp.utc_ns, kp.pending) == (1, "operator@gcs", 7, False)
    reset = StoredSetting(version=2, history=(change,))
    kp = keys(folder, running=running, live={KP.path: LiveValue(KP, 1.5, reset)})["navigator/altitude_kp"]
    assert (kp.origin, kp.version) == ("file", 2)
    assert not keys(folder)["navigator/altitude_kp"].live, "a platform whose template does not have it"


def test_live_setting_of_module_has_no_file(tmp_path: Path) -> None:
    folder = make_node(tmp_path, services={"broker": {}})
    mode = keys(folder, live={LIMIT.path: LiveValue(LIMIT, "full", None)}, meanings=True)["motor/mode"]
    assert (plain(mode.value), plain(mode.default), mode.type) == ("full", "eco", "string")
    assert (mode.limits, mode.service, mode.file, mode.meaning) == ("eco, full", "", "", "Mode of the motor")


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("navigator/altitude_kp", ["navigator/altitude_kp"]),
        ("navigator/altitude.kp_1_s", ["navigator/altitude_kp"]),
        ("navigator/altitude*", ["navigator/altitude_kp", "navigator/altitude_ki", "navigator/altitude_kd"]),
        ("*/rest_hz", ["navigator/rest_hz"]),
        ("node/{unit,kind}", ["node/unit", "node/kind"]),
        ("nosuch/*", []),
    ],
)
def test_keys_are_found_by_pattern_and_place(tmp_path: Path, pattern: str, names: list[str]) -> None:
    folder = make_node(tmp_path, services={"navigator": {}})
    assert [key.name for key in effective_config(folder, {}, {}, pattern).keys] == names


def test_one_star_matches_the_keys_of_tables(tmp_path: Path) -> None:
    folder = make_node(tmp_path, services={"navigator": {}})
    found = effective_config(folder, {}, {}, "navigator/*").keys
    assert len(found) == len(described_keys(find("navigator").Config))
    with pytest.raises(InvalidInput):
        key_pattern("{" * 500)


def test_a_password_does_not_leave_the_node(tmp_path: Path) -> None:
    uri = "mongodb://swarm:s3cret@10.0.0.1:27017"
    folder = make_node(tmp_path, services={"logger": {"mongodb_uri": uri}})
    found = effective_config(folder, {"logger": {"mongodb_uri": uri}}, {}, "logger/mongodb_uri")
    assert b"s3cret" not in msgspec.msgpack.encode(found)
    assert plain(found.keys[0].value) == "mongodb://swarm:***@10.0.0.1:27017"
    assert not found.keys[0].pending


def test_service_that_is_not_installed_is_problem(tmp_path: Path) -> None:
    folder = make_node(tmp_path, services={"nosuch": {}, "tree": {}})
    found = effective_config(folder, {}, {})
    assert "'nosuch': not installed" in found.problems[0]
    assert {key.service for key in found.keys} == {"node", "tree"}


def test_halves_of_service_share_keys_and_settings(tmp_path: Path) -> None:
    both = keys(
        make_node(tmp_path, services={"estimator": {}, "guidance": {}, "navigator": {"rate_hz": 25.0}})
    )
    halves = make_node(tmp_path / "two", services={"estimator": {}, "guidance": {}})
    (halves / "services/navigator.toml").write_text("rate_hz = 25.0\n")
    found = keys(halves)
    assert {name for name in found if not name.startswith("node/")} == {
        name for name in both if name.startswith("navigator/")
    }
    assert "navigator/altitude_kp" in found
    assert found["navigator/rate_hz"].value == both["navigator/rate_hz"].value
    assert found["navigator/rate_hz"].origin == "file"
