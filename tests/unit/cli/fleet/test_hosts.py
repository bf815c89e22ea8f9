"""The file of a fleet: defaults, own keys, files to push; errors name line and key."""

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest
from file_schemas import hosts_schema
from tests.unit.cli.fleet.hosts import HOST, read

from swarmctl.commands.fleet.ssh import command_line
from swarmctl.membership import hosts
from swarmware.errors import ConfigError, InvalidInput, NotFound

TWO = """
[defaults]
user = "pilot"
port = 2222
services = "services"
[defaults.node]
kind = "uav"
[[hosts]]
name = "uav1"
address = "10.0.0.1"
[[hosts]]
name = "gcs"
address = "gcs.local"
port = 22
services = ""
[hosts.node]
kind = "gcs"
template = "gcs"
"""


def test_keys_of_host_replace_all_defaults() -> None:
    uav, gcs = read(TWO)
    assert (uav.keys.user, uav.keys.port, uav.keys.services) == ("pilot", 2222, "services")
    assert (gcs.keys.user, gcs.keys.port, gcs.keys.services) == ("pilot", 22, "")
    assert uav.node == {"kind": "uav", "platform": "uav1"}
    assert gcs.node == {"kind": "gcs", "template": "gcs", "platform": "gcs"}


@pytest.mark.parametrize(
    ("text", "line", "part"),
    [
        ("", 0, "hosts"),
        ("hosts = []\n", 1, "hosts"),
        ('[[hosts]]\naddress = "a"\n', 1, "name"),
        (HOST + "prot = 1\n", 4, "did you mean port"),
        (HOST + "port = 0\n", 4, "port"),
        (HOST.replace('"a"', '"-oProxyCommand=x"'), 3, "address"),
        (HOST + 'user = "a b"\n', 4, "user"),
        (HOST + 'supervisor = "runit"\n', 4, "supervisor"),
        (HOST + 'prefix = "opt"\n', 4, "prefix"),
        (HOST.replace("uav1", "Uav 1"), 2, "hosts[0].name"),
        (HOST + HOST, 5, "already"),
        (HOST + HOST.replace("uav1", "uav2"), 6, "same host"),
        (HOST + '[hosts.node]\nkind = "uva"\n', 5, "hosts[0].node.kind"),
        (HOST + '[hosts.node]\nplatform = "x"\n', 5, "hosts[0].node.platform"),
        ('[defaults.node]\nkindd = "uav"\n' + HOST, 2, "defaults.node.kindd"),
    ],
)
def test_invalid_file_is_refused_with_line_and_key(text: str, line: int, part: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read(text)
    assert "HOSTS.toml" in str(caught.value)
    assert part in str(caught.value)
    assert caught.value.line == line


def test_pushed_files_come_from_folders_beside_file(tmp_path: Path) -> None:
    (tmp_path / "services").mkdir()
    (tmp_path / "services/broker.toml").write_text("udp_port = 1\n")
    (tmp_path / "services/notes.txt").write_text("not pushed")
    mission = tmp_path / "relay"
    mission.mkdir()
    (mission / "mission.toml").write_text("x")
    text = TWO.replace('services = ""', 'services = ""\nmissions = ["relay"]')
    uav, gcs = read(text, tmp_path)
    found = hosts.files(uav)
    assert sorted(found) == ["config/node.toml", "config/services/broker.toml"]
    assert tomllib.loads(found["config/node.toml"].decode())["platform"] == "uav1"
    assert sorted(hosts.files(gcs)) == ["config/node.toml", "data/missions/relay/mission.toml"]
    before = hosts.digest(found)
    assert hosts.digest(hosts.files(uav)) == before
    (tmp_path / "services/broker.toml").write_text("udp_port = 2\n")
    assert hosts.digest(hosts.files(uav)) != before
    (mission / "mission.toml").unlink()
    with pytest.raises(InvalidInput, match=r"no mission\.toml"):
        hosts.files(gcs)


def test_hosts_are_selected_by_name_and_pattern() -> None:
    found = read(TWO)
    file = Path("HOSTS.toml")
    assert [host.name for host in hosts.choose(found, "", file)] == ["uav1", "gcs"]
    assert [host.name for host in hosts.choose(found, "g*,uav1", file)] == ["gcs", "uav1"]
    with pytest.raises(NotFound, match="uav7"):
        hosts.choose(found, "uav7", file)


def test_the_schema_accepts_what_the_reader_accepts() -> None:
    schema = json.loads(hosts_schema())
    jsonschema.validate(tomllib.loads(TWO), schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"hosts": [{"name": "uav1", "address": "a", "prot": 1}]}, schema)


def test_host_names_are_completed_from_valid_file_only(
    tmp_path: Path,
) -> None:
    file = tmp_path / "HOSTS.toml"
    file.write_text(TWO)
    assert hosts.host_names(str(file), "u") == ["uav1"]
    for content in ("hosts = 3", "hosts = [1]", "[[hosts"):
        file.write_text(content)
        assert hosts.host_names(str(file), "") == []
    assert hosts.host_names("", "") == []


def test_ssh_words_are_quoted_for_remote_shell() -> None:
    uav, gcs = read(TWO.replace('"10.0.0.1"', '"10.0.0.1"\nsudo = true\nidentity = "key"'))
    line = command_line(uav, ["echo", "a b", "$(reboot)", "'"], 5.0)
    assert line[0] == "ssh"
    assert line[-3:] == ["--", "10.0.0.1", """sudo -n -- echo 'a b' '$(reboot)' ''"'"''"""]
    assert "StrictHostKeyChecking=yes" in line
    assert "BatchMode=yes" in line
    assert line[line.index("-i") + 1] == "/fleet/key"
    assert command_line(gcs, ["true"], 5.0)[-1] == "true"
