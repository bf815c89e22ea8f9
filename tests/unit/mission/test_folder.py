"""A mission for an ensemble: manifest, roles, parameters, and whether the roles fit together."""

import contextlib
import json
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.mission.manifests import AIR_AND_CONTROL

from swarmware.errors import ConfigError, MissionError, NotFound
from swarmware.mission.assignment import Platform, assign
from swarmware.mission.check import check_files, check_folder
from swarmware.mission.finding import sound
from swarmware.mission.folder import Folder, from_files, read_folder
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionFile

MANIFEST = f"""
name = "relay"
[[roles]]
name = "leader"
file = "leader.json"
kinds = ["ugv"]
take = 1
{AIR_AND_CONTROL}
[params]
head = "$role.leader"
"""


def part(*blocks: dict[str, Any], **params: Any) -> str:
    body: dict[str, Any] = {"b0": {"type": "Start", "next": "b1"}}
    for number, block in enumerate(blocks, 1):
        body[f"b{number}"] = {"next": f"b{number + 1}", **block}
    body[f"b{len(blocks) + 1}"] = {"type": "End"}
    return json.dumps({"mission": body, "params": params}, indent=1)


MEET = {"type": "Barrier", "id": "up", "timeout_s": 9}
LEADER = part(MEET)
AIR = part(
    {"type": "Arm"},
    {"type": "Takeoff", "alt": "$param.height"},
    MEET,
    {"type": "Formation", "leader": "$param.head"},
    height=5.0,
    head="ugv1",
)
FILES = {"mission.toml": MANIFEST, "leader.json": LEADER, "air.json": AIR, "control.json": part(MEET)}
SWARM = [
    Platform("uav10", PlatformKind.UAV),
    Platform("gcs", PlatformKind.GCS),
    Platform("uav2", PlatformKind.UAV),
    Platform("ugv2", PlatformKind.UGV),
    Platform("ugv1", PlatformKind.UGV),
]


def files(**changed: str) -> list[MissionFile]:
    return [MissionFile(name, text) for name, text in {**FILES, **changed}.items()]


def test_roles_fill_with_platforms_in_natural_order() -> None:
    cast = assign(from_files(files(), ""), SWARM, {})
    assert [(m.platform, m.role) for m in cast.members] == [
        ("ugv1", "leader"),
        ("uav2", "air"),
        ("uav10", "air"),
        ("gcs", "control"),
    ]
    assert cast.left_out == ("ugv2",)


def test_every_platform_gets_its_own_parameters() -> None:
    cast = assign(from_files(files(), ""), SWARM, {})
    params = {p.member.platform: p.binding.params for p in cast.member_assignments}
    assert params["uav2"] == {"head": "ugv1", "height": 5.0}
    assert params["uav10"] == {"head": "ugv1", "height": 6.5}


def test_the_operator_may_give_other_parameters() -> None:
    folder = from_files(files(), "")
    cast = assign(folder, SWARM, {"height": 9.0})
    assert cast.member_assignments[1].binding.params["height"] == 9.0
    with pytest.raises(MissionError, match="'hight': unknown in relay; expected head, height"):
        assign(folder, SWARM, {"hight": 9.0})


def test_a_required_role_without_a_platform_is_named() -> None:
    folder = from_files(files(), "")
    with pytest.raises(MissionError, match="role 'leader': no ugv"):
        assign(folder, [Platform("uav1", PlatformKind.UAV), Platform("gcs", PlatformKind.GCS)], {})
    assert (
        len(
            assign(
                folder, [Platform("uav1", PlatformKind.UAV), Platform("ugv1", PlatformKind.UGV)], {}
            ).member_assignments
        )
        == 2
    )


def test_the_hash_is_of_all_names_and_contents() -> None:
    one = from_files(files(), "a")
    assert one.hash == from_files(list(reversed(files())), "elsewhere").hash
    assert one.hash != from_files(files(**{"air.json": AIR + " "}), "a").hash
    assert len(one.hash) == 32


def test_single_file_is_mission_for_every_vehicle() -> None:
    folder = from_files([MissionFile("hop.json", LEADER)], "")
    cast = assign(folder, SWARM, {})
    assert [m.platform for m in cast.members] == ["uav2", "uav10", "ugv1", "ugv2"]
    assert folder.manifest.name == "hop"


def test_roles_that_fit_together_have_no_findings() -> None:
    assert {(f.severity, f.rule) for f in check_folder(from_files(files(), ""))} == {
        ("warning", "broken-barrier"),
        ("warning", "ends-in-the-air"),
    }


def reaction(**keys: str) -> str:
    """A row of a manifest."""
    row = {"name": "hot", "when": "battery < 10 %", "action": "hold"} | keys
    return "[[reaction]]\n" + "".join(f"{key} = {value!r}\n" for key, value in row.items())


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("control.json", part({"type": "Wait", "s": 1}), "role 'control' never reaches it"),
        ("control.json", part({**MEET, "quorum": 2}), "quorum or roles differ"),
        ("control.json", part({**MEET, "roles": ["air", "leader"]}), "quorum or roles differ"),
        ("leader.json", part({**MEET, "roles": ["air"]}), "is not for role 'leader'"),
        ("leader.json", part({**MEET, "roles": ["leader", "sea"]}), "role 'sea' does not exist"),
        ("leader.json", part({"type": "Takeoff", "alt": 1}, MEET), "can be a ugv, which cannot Takeoff"),
        ("leader.json", part({"type": "Fly"}, MEET), "'Fly': unknown"),
        ("mission.toml", MANIFEST + "tail = 3\n", "key params.tail: no role declares it"),
        (
            "mission.toml",
            MANIFEST + reaction(when="battery < 2 % or power/battery.remaining < 1"),
            "key reaction[0].when: column 18 of condition 'battery < 2 % or power/battery.remaining < 1'",
        ),
        (
            "mission.toml",
            MANIFEST + reaction(possible="nav/pose.xm < 1", otherwise="land"),
            "key reaction[0].possible: column 1 of condition 'nav/pose.xm < 1': Pose has no field 'xm'",
        ),
    ],
)
def test_roles_that_do_not_fit_are_named(name: str, text: str, words: str) -> None:
    found = check_folder(from_files(files(**{name: text}), "relay"))
    assert any(words in finding.message for finding in found), found
    assert all(finding.file.startswith("relay/") for finding in found)


@pytest.mark.parametrize(
    ("manifest", "words"),
    [
        ("name = 3", "key name"),
        ("name = 'a'\nroles = []", "key roles: expected `array` of length >= 1"),
        (MANIFEST.replace("air.json", "../air.json"), "file"),
        (MANIFEST.replace("air.json", "sea.json"), "'sea.json' is missing"),
        (MANIFEST.replace('["uav"]', '["plane"]'), "key roles[1].kinds[0]: unknown kind 'plane'"),
        (MANIFEST.replace('"air"', '"leader"'), "unique names"),
        (MANIFEST + "[more]\n", "key more: unknown"),
        (
            MANIFEST + reaction(when="battery <"),
            "key reaction[0]: reaction hot, key when: condition",
        ),
        (MANIFEST + reaction(action="fly"), "key reaction[0].action: invalid enum value 'fly'"),
        (MANIFEST + 2 * reaction(), "key reaction[1].name: 'hot' is a row already; expected unique names"),
        (MANIFEST + reaction(name="link_loss"), "key reaction[0].name: row 'link_loss' is set by the keys"),
    ],
)
def test_a_manifest_that_does_not_fit_is_refused(manifest: str, words: str) -> None:
    with pytest.raises(ConfigError, match=r"relay/mission\.toml") as caught:
        from_files(files(**{"mission.toml": manifest}), "relay")
    assert words in str(caught.value)


def test_several_files_need_a_manifest() -> None:
    with pytest.raises(ConfigError, match=r"2 files without mission\.toml"):
        from_files([MissionFile("a.json", LEADER), MissionFile("b.json", LEADER)], "x")


def test_folder_on_disk_is_checked_like_its_content(tmp_path: Path) -> None:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "README.md").write_text("not part of it")
    assert read_folder(tmp_path).hash == from_files(files(), "").hash
    assert check_files([tmp_path, tmp_path / "mission.toml"]) == 2 * check_files([tmp_path])
    assert sound(check_files([tmp_path]))
    (tmp_path / "control.json").unlink()
    (finding,) = check_files([tmp_path])
    assert "control.json" in finding.message


def test_path_that_does_not_exist_is_not_found(tmp_path: Path) -> None:
    with pytest.raises(NotFound):
        check_files([tmp_path / "nothing.json"])
    with pytest.raises(NotFound):
        check_files([tmp_path])
    with pytest.raises(NotFound):
        read_folder(tmp_path)


@given(st.text(max_size=80), st.text("mission.tojabc", max_size=14))
def test_any_content_is_a_folder_or_our_error(text: str, name: str) -> None:
    for manifest in (MANIFEST, text):
        with contextlib.suppress(ConfigError):
            check_folder(from_files([MissionFile("mission.toml", manifest), MissionFile(name, text)], ""))


def lay(folder: Path, **texts: str) -> Path:
    for member, text in texts.items():
        (folder / member).mkdir(parents=True)
        (folder / member / "mission.json").write_text(text)
    return folder


def test_folder_per_id_is_mission_in_order(tmp_path: Path) -> None:
    once, twice = part(MEET), part({**MEET, "id": "up"}, {"type": "Barrier", "id": "up"})
    folder = read_folder(lay(tmp_path / "duty", **{"2": once, "10": twice, "uav2": once, "gcs": once}))
    assert folder.manifest.name == "duty"
    assert sorted(folder.texts) == [f"{member}/mission.json" for member in ("10", "2", "gcs", "uav2")]
    cast = assign(folder, SWARM, {})
    roles = {member.role: member.platform for member in cast.members}
    assert roles == {"gcs": "gcs", "uav2": "uav2", "2": "uav10", "10": "ugv1"}
    with pytest.raises(MissionError, match="role 'uav2': 'uav2' is not available; expected it"):
        assign(folder, [platform for platform in SWARM if platform.name != "uav2"], {})


def test_finding_in_folder_of_id_names_its_file(tmp_path: Path) -> None:
    once, twice = part({"type": "Barrier", "id": "x"}), part(*[{"type": "Barrier", "id": "x"}] * 2)
    lay(tmp_path / "m", **{"1": twice, "2": once})
    (finding,) = [found for found in check_files([tmp_path / "m"]) if found.severity == "error"]
    assert finding.rule == "unequal-visits"
    assert finding.file == str(tmp_path / "m" / "1" / "mission.json")
    assert finding.pointer == "/mission/b2"
    folder = read_folder(tmp_path / "m")
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(folder), type=Folder) == folder


def test_folder_with_one_mission_is_read_without_manifest(tmp_path: Path) -> None:
    (tmp_path / "hop").mkdir()
    (tmp_path / "hop" / "mission.json").write_text(LEADER)
    folder = read_folder(tmp_path / "hop")
    assert (folder.manifest.name, [role.name for role in folder.manifest.roles]) == ("hop", ["all"])
    (tmp_path / "empty" / "1").mkdir(parents=True)
    with pytest.raises(NotFound, match=r"mission\.toml, mission\.json or <id>/mission\.json"):
        read_folder(tmp_path / "empty")


def test_a_role_may_name_its_platform() -> None:
    manifest = MANIFEST.replace('name = "air"\n', 'name = "air"\nplatform = "uav10"\n')
    cast = assign(from_files(files(**{"mission.toml": manifest}), ""), SWARM, {})
    assert [member.platform for member in cast.members if member.role == "air"] == ["uav10"]
    assert "uav2" in cast.left_out
